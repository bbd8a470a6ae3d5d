use std::io::{Read, Write};

use rustix::termios::{InputModes, LocalModes};
use tempfile::tempdir;

use super::*;

#[test]
fn a_terminal_knows_whether_a_client_is_there() {
    let dir = tempdir().expect("a folder");
    let path = dir.path().join("pve0");
    let terminal = Terminal::open(&path).expect("a terminal");
    assert!(!terminal.is_in_use(), "before the first");
    for _ in 0..3 {
        let mut client = super::open(&path).expect("the link leads to it");
        assert!(terminal.is_in_use());
        client.write_all(b"V\r").expect("room");
        drop(client);
        assert!(terminal.is_in_use(), "there is something to read");
        let mut bytes = [0; 8];
        assert_eq!(rustix::io::read(&terminal.end, &mut bytes).map(|len| bytes[..len].to_vec()), Ok(b"V\r".to_vec()));
        assert!(!terminal.is_in_use());
    }
}

/// A client that changes the terminal modes and never reads.
fn rude_client(terminal: &Terminal, path: &Path) -> File {
    let rude = super::open(path).expect("the link leads to it");
    let mut attributes = tcgetattr(&rude).expect("attributes");
    attributes.local_modes |= LocalModes::ECHO | LocalModes::ICANON;
    attributes.input_modes |= InputModes::ICRNL;
    tcsetattr(&rude, OptionalActions::Now, &attributes).expect("attributes");
    while rustix::io::write(&terminal.end, &[b't'; 1000]).is_ok() {}
    rude
}

/// Asserts that CR stays CR, that nothing is echoed, and that no output of a previous client arrives.
fn assert_new(terminal: &Terminal, client: &mut File) {
    let mut bytes = [0; 8];
    while rustix::io::read(&terminal.end, &mut bytes).is_ok() {}
    rustix::io::write(&terminal.end, b"\x07\r").expect("room");
    assert_eq!(client.read(&mut bytes).map(|len| bytes[..len].to_vec()).expect("bytes"), b"\x07\r");
    assert!(rustix::io::read(&terminal.end, &mut bytes).is_err(), "nothing is echoed");
}

/// slcand can install its line discipline between the end of the previous client and the reset. The device then refuses
/// to flush, as `/dev/null` does here; a new terminal would hang up on slcand.
#[test]
fn a_reset_spares_a_client_with_its_own_line_discipline() {
    let dir = tempdir().expect("a folder");
    let mut terminal = Terminal::open(&dir.path().join("pve0")).expect("a terminal");
    let device = std::mem::replace(&mut terminal.link.device, "/dev/null".into());
    assert!(terminal.reset().is_ok());
    terminal.link.device = device;
}

#[test]
fn a_new_terminal_has_nothing_of_the_one_before() {
    let dir = tempdir().expect("a folder");
    let path = dir.path().join("pve0");
    let mut terminal = Terminal::open(&path).expect("a terminal");
    let mut rude = rude_client(&terminal, &path);
    terminal.renew().expect("a terminal");
    // As for an unplugged device: the end of file on Linux, an error elsewhere.
    assert!(matches!(rude.read(&mut [0; 8]), Ok(0) | Err(_)));
    assert!(!terminal.is_in_use());
    let mut client = super::open(&path).expect("the link leads to the new one");
    assert!(terminal.is_in_use());
    assert_new(&terminal, &mut client);
}

#[test]
fn the_next_client_may_come_before_the_terminal_is_reset() {
    let dir = tempdir().expect("a folder");
    let path = dir.path().join("pve0");
    let terminal = Terminal::open(&path).expect("a terminal");
    drop(rude_client(&terminal, &path));
    let mut client = super::open(&path).expect("the link leads to it");
    terminal.reset().expect("a terminal");
    assert!(terminal.is_in_use());
    assert_new(&terminal, &mut client);
    drop(client);
    assert!(!terminal.is_in_use());
}

#[test]
fn a_link_goes_with_its_terminal_unless_it_is_another_one() {
    let dir = tempdir().expect("a folder");
    let path = dir.path().join("pve0");
    drop(Terminal::open(&path).expect("a terminal"));
    assert!(path.symlink_metadata().is_err(), "the link is gone");
    let terminal = Terminal::open(&path).expect("a terminal");
    fs::remove_file(&path).expect("the link");
    fs::write(&path, "mine").expect("a file");
    drop(terminal);
    assert_eq!(fs::read_to_string(&path).expect("the file"), "mine");
}

#[test]
fn nothing_is_replaced_but_a_link_that_was_left_behind() {
    let dir = tempdir().expect("a folder");
    let path = dir.path().join("pve0");
    let terminal = Terminal::open(&path).expect("a terminal");
    assert!(Terminal::open(&path).is_err(), "of another that runs");
    // Left behind by a killed simulator: a link to a terminal that no longer exists, or whose number the new terminal
    // has.
    symlink(&terminal.link.device, dir.path().join("same")).expect("a link");
    assert!(is_stale(&dir.path().join("same"), &terminal.link.device));
    let gone = terminal.link.device.with_file_name("123456789");
    drop(terminal);
    symlink(gone, &path).expect("a link");
    drop(Terminal::open(&path).expect("the link is replaced"));
    symlink("/nowhere/else", &path).expect("a link");
    assert!(Terminal::open(&path).is_err(), "a link to elsewhere");
    assert_eq!(fs::read_link(&path).expect("the link"), Path::new("/nowhere/else"));
}

#[test]
fn a_file_in_the_way_is_named() {
    let dir = tempdir().expect("a folder");
    let path = dir.path().join("pve0");
    fs::write(&path, "mine").expect("a file");
    let told = |error: io::Error| error.to_string();
    let refused = Terminal::open(&path).map(drop).map_err(told);
    assert_eq!(refused, Err(format!("{} exists and is not a stale link", path.display())));
    fs::remove_file(&path).expect("a file");
    let mut terminal = Terminal::open(&path).expect("a terminal");
    let next = dir.path().join("pve0.next");
    fs::write(&next, "mine").expect("a file");
    assert_eq!(terminal.renew().map_err(told), Err(format!("{} exists and is not a stale link", next.display())));
    assert_eq!(fs::read_to_string(&next).expect("the file"), "mine");
}
