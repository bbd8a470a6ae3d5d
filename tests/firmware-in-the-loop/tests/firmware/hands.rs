//! What a user does with the board and sees of it: console, button, LEDs.

use protocol_core::time::{Duration, after, since};

use super::client::ImageClient;

/// How long the console may take for an answer; a store with an erase is in it.
const PATIENCE: Duration = Duration::from_millis(1000);
/// What the LEDs are looked at in, in milliseconds.
const LOOK: u64 = 3;
/// How long they are looked at: more than two periods of flashing.
const WATCHED: Duration = Duration::from_millis(1500);
/// The cycle of the frames of a master.
const CYCLE: Duration = Duration::from_millis(100);
/// How long a level lasts while flashing, in milliseconds.
const HALF_PERIOD: u64 = 333;

/// What both LEDs show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    Dark,
    Red,
    Green,
    Yellow,
    RedFlashing,
    GreenFlashing,
    YellowFlashing,
    /// None of these.
    Odd,
}

impl ImageClient {
    /// Types a line and waits for the answer, which is given without the line that ends it.
    ///
    /// The end is a line `ok`, or one that points to the help: [`Err`].
    pub fn console(&mut self, line: &str) -> Result<Vec<String>, String> {
        self.printed();
        self.type_line(line);
        let end = after(self.rig.boards.world.now(), PATIENCE);
        let mut answer = String::new();
        loop {
            assert!(self.rig.boards.world.now() < end, "{line:?} is answered {answer:?}");
            self.step();
            answer += &self.printed();
            let Some(complete) = answer.strip_suffix("\r\n") else { continue };
            let mut lines: Vec<String> = complete.split("\r\n").map(str::to_owned).collect();
            match lines.pop() {
                Some(last) if last == "ok" => return Ok(lines),
                Some(last) if last.ends_with("help lists all words") => return Err(last),
                _ => {}
            }
        }
    }

    /// Types a line that has to be understood.
    pub fn obeyed(&mut self, line: &str) -> Vec<String> {
        self.console(line).unwrap_or_else(|usage| panic!("{line:?} is not understood: {usage}"))
    }

    /// The lines of `status`, each a name and a value.
    pub fn status(&mut self) -> Vec<(String, String)> {
        let pair = |line: String| {
            let (name, value) = line.split_once(' ').unwrap_or_else(|| panic!("{line:?} is no name and value"));
            (name.to_owned(), value.to_owned())
        };
        self.obeyed("status").into_iter().map(pair).collect()
    }

    /// The value of a name in `status`.
    pub fn status_of(&mut self, name: &str) -> String {
        let status = self.status();
        let found = status.iter().find(|(known, _)| known == name);
        found.unwrap_or_else(|| panic!("{name} is missing in {status:?}")).1.clone()
    }

    /// Presses the user button and lets go, each for longer than it bounces.
    pub fn press_button(&mut self) {
        for (pressed, ms) in [(true, 100), (false, 100)] {
            self.drive_button(pressed);
            self.wait_ms(ms);
        }
    }

    /// Sets the level of the button.
    pub fn drive_button(&mut self, pressed: bool) {
        let board = self.machine().image().board();
        let (port, pin) = board.button;
        self.machine().drive(port, pin, pressed == board.pressed);
    }

    /// What the LEDs show, watched for a while in which frames are put aside.
    pub fn leds(&mut self) -> Shown {
        self.leds_while_sending(None)
    }

    /// The same, while this frame is sent every 100 ms.
    pub fn leds_while_sending(&mut self, cyclic: Option<&str>) -> Shown {
        // A change shows from the next half period on.
        let mut next = self.rig.boards.world.now();
        let start = after(next, Duration::from_millis(HALF_PERIOD + LOOK));
        let mut levels: Vec<((bool, bool), u64)> = Vec::new();
        while since(self.rig.boards.world.now(), start) < WATCHED {
            if let Some(frame) = cyclic.filter(|_| self.rig.boards.world.now() >= next) {
                self.send(frame);
                next = after(next, CYCLE);
            }
            let &[red, green] = self.machine().image().board().leds else { panic!("it has no red and green LED") };
            let is_high = |(port, pin)| self.machine().is_high(port, pin);
            let level = (is_high(red), is_high(green));
            match levels.last_mut() {
                _ if self.rig.boards.world.now() < start => {}
                Some((last, ms)) if *last == level => *ms += LOOK,
                _ => levels.push((level, LOOK)),
            }
            self.wait_ms(LOOK);
        }
        let steady = |level| match level {
            (false, false) => Shown::Dark,
            (true, false) => Shown::Red,
            (false, true) => Shown::Green,
            (true, true) => Shown::Yellow,
        };
        let colors: Vec<_> = levels.iter().map(|(level, _)| *level).collect();
        let on = colors.iter().copied().find(|level| *level != (false, false));
        match (colors.as_slice(), on) {
            ([level], _) => steady(*level),
            (levels_seen, Some(on)) if levels_seen.iter().all(|level| *level == on || *level == (false, false)) => {
                // The first and the last are cut by the time of watching.
                let whole = &levels[1..levels.len() - 1];
                assert!(
                    !whole.is_empty() && whole.iter().all(|(_, ms)| ms.abs_diff(HALF_PERIOD) <= 2 * LOOK),
                    "{levels:?}"
                );
                match steady(on) {
                    Shown::Red => Shown::RedFlashing,
                    Shown::Green => Shown::GreenFlashing,
                    _ => Shown::YellowFlashing,
                }
            }
            _ => Shown::Odd,
        }
    }
}
