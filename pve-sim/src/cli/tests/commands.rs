//! The other commands, and the help.

use super::*;

#[test]
fn use_cases_one_or_all() {
    let names = |line: &str| match parse(args(line)) {
        Ok(Request::UseCases(cases)) => cases.iter().map(|case| case.name).collect::<Vec<_>>(),
        other => panic!("{line}: {other:?}"),
    };
    assert_eq!(names("use-case 3"), ["3"]);
    assert_eq!(names("use-case all"), ["1", "2", "3", "4", "5", "6", "isobus", "hat"]);
    assert_eq!(names("use-case isobus"), ["isobus"]);
}

/// The help names each of them.
#[test]
fn every_kind_has_one_description() {
    let of = |command: &str| {
        let help = printed(&format!("help {command}"));
        let described = Kind::ALL.into_iter().filter(|kind| parse(args(&format!("{command} {kind}"))).is_ok());
        let names = described.map(Kind::name).collect::<Vec<_>>();
        assert!(help.contains(&format!("<{}>", names.join("|"))), "{help}");
        names
    };
    let mut all = of("eds");
    all.extend(of("dbc"));
    let mut kinds = Kind::ALL.map(Kind::name);
    all.sort_unstable();
    kinds.sort_unstable();
    assert_eq!(all, kinds);
}

#[test]
fn use_case_without_a_name_lists_the_titles() {
    let titles = printed("use-case");
    for case in use_case::ALL {
        assert!(titles.contains(&format!("{:<8}{}\n", case.name, case.title())), "{titles}");
        assert!(case.text.contains(&format!("title = \"Use case {}: {}\"\n", case.name, case.title())), "{titles}");
    }
}

#[test]
fn the_help_is_a_command_too() {
    assert_eq!(printed("help"), printed("--help"));
    assert!(printed("help use-case").contains("[1-6|isobus|hat|all]"));
}

#[test]
fn the_help_lists_kinds_identifiers_and_keys_one_a_line() {
    // A narrower terminal wraps its lines.
    let help = Cli::command().term_width(120).render_long_help().to_string();
    let lines: Vec<&str> = help.lines().map(str::trim).collect();
    let kinds = Kind::ALL.map(Kind::name);
    for word in kinds.into_iter().chain(["on CANopen", "on ISOBUS", "name=NAME", "serial=N", "blank"]) {
        assert_eq!(lines.iter().filter(|line| line.starts_with(word)).count(), 1, "{word}: {help}");
    }
    assert!(printed("--help").lines().all(|line| line.chars().count() <= 120), "{help}");
}

/// No line of `--device` wraps at 100 columns, the widest help: its keys would lose their columns.
#[test]
fn the_help_of_a_device_keeps_its_columns() {
    let of_device = |columns| {
        let help = Cli::command().term_width(columns).render_long_help().to_string();
        let (_, rest) = help.split_once("--device").expect("an option");
        rest.split_once("--link").expect("the next one").0.to_owned()
    };
    assert_eq!(of_device(100), of_device(1000));
}

#[test]
fn the_help_names_every_option_and_its_default() {
    let help = printed("--help");
    for option in option_names(&[]) {
        assert!(help.contains(&option), "{option} in\n{help}");
    }
    assert!(help.contains("socketcand://127.0.0.1:29536/pve0"));
    assert!(printed("run --help").contains("--device"));
    assert!(printed("--version").starts_with("pve-sim "));
}

#[test]
fn a_running_simulator() {
    let word = |name: &str, value: &str| PlantWord { name: name.to_owned(), value: value.to_owned() };
    let Ok(Request::Set(options)) = parse(args("set boom lever=-4000 spool=a=b --http [::1]:80")) else {
        panic!("it is right");
    };
    assert_eq!((options.http, options.device.as_str()), ("[::1]:80".parse().unwrap(), "boom"));
    assert_eq!(options.words, [word("lever", "-4000"), word("spool", "a=b")]);
    let Ok(Request::Set(options)) = parse(args("set boom lever=off")) else { panic!("it is right") };
    assert_eq!(options.http, DEFAULT_HTTP);
    let status = |line: &str| match parse(args(line)) {
        Ok(Request::Status(options)) => options,
        other => panic!("{line}: {other:?}"),
    };
    assert_eq!(status("status"), StatusArgs { http: DEFAULT_HTTP, device: None, json: false });
    let http = "127.0.0.1:9".parse().unwrap();
    assert_eq!(
        status("status boom --json --http 0.0.0.0:9"),
        StatusArgs { http, device: Some("boom".to_owned()), json: true }
    );
    for (line, part) in [
        ("set", "<DEVICE> <WORD=VALUE>..."),
        ("set boom", "<WORD=VALUE>..."),
        ("set lever=off", "<WORD=VALUE>..."),
        ("set boom lever", "must be WORD=VALUE, as in supply_mv=8000"),
        ("set boom =off", "must be WORD=VALUE, as in supply_mv=8000"),
        ("set boom lever=off spool=ok lever=off", "duplicate word lever"),
        ("set boom lever=off --http 8408", "must be ADDR:PORT, as in 127.0.0.1:8408"),
        ("status boom arm", "'arm'"),
        ("status --http 127.0.0.1:0", "must be ADDR:PORT, as in 127.0.0.1:8408"),
        ("--http 127.0.0.1:9 status", "give the options after the command"),
    ] {
        let text = refused(line);
        assert!(text.contains(part) && !text.contains('\n'), "{line}: {text}");
    }
}

#[test]
fn recordings() {
    match parse(args("decode -")) {
        Ok(Request::Decode(options)) => assert_eq!(options, DecodeOptions { file: "-".into(), devices: vec![] }),
        other => panic!("{other:?}"),
    }
    // Equal node IDs do not clash: no device sends here.
    assert!(matches!(parse(args("decode a.log --device hat1000 --device hat1000")), Ok(Request::Decode(_))));
    let Ok(Request::Replay(options)) = parse(args(
        "replay a.asc --device pvea-canopen --device hat1000,bit-rate=250k --link pvea-canopen=hat1000 --tolerance-ms 0 \
         --from-boot-up --seed 9",
    )) else {
        panic!("it is right");
    };
    assert_eq!((options.file, options.devices.len(), options.links.len()), (PathBuf::from("a.asc"), 2, 1));
    assert_eq!((options.tolerance.as_millis(), options.from_boot_up, options.seed), (0, true, 9));
    let Ok(Request::Replay(options)) = parse(args("replay a.asc --device pvea-canopen")) else { panic!("it is right") };
    assert_eq!((options.tolerance.as_millis(), options.from_boot_up, options.seed), (5, false, 1));
    for (line, part) in [
        ("replay a.log", "--device <KIND[@ID][,KEY=VALUE…]>"),
        ("replay --device hat1000", "<FILE>"),
        ("replay - --device hat1000", "stdin cannot be read more than once"),
        ("replay a.log --device hat1000 --device hat3000", "both have node ID 0x01"),
        ("replay a.log --device hat1000 --tolerance-ms -1", "-1"),
        ("replay a.log --device hat1000 --link boom=hat1000", "no valve 'boom' on the bus"),
        ("decode", "<FILE>"),
        ("decode a.log --device hat", "unknown kind 'hat'"),
    ] {
        let text = refused(line);
        assert!(text.contains(part) && !text.contains('\n'), "{line}: {text}");
    }
}
