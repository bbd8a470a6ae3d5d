#compdef pve-sim

autoload -U is-at-least

_pve-sim() {
    typeset -A opt_args
    typeset -a _arguments_options
    local ret=1

    if is-at-least 5.2; then
        _arguments_options=(-s -S -C)
    else
        _arguments_options=(-s -C)
    fi

    local context curcontext="$curcontext" state line
    _arguments "${_arguments_options[@]}" : \
'*--device=[A device on the bus; repeatable \[default\: pvea-canopen@0x20\]]:KIND[@ID][,KEY=VALUE…]:_default' \
'*--link=[The shaft of SENSOR follows the spool of VALVE, as a boom that the valve moves; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--state=[Keep each device'\''s memory in DIR/NAME.nvm; without it the memory is lost at exit]:DIR:_files -/' \
'*--bus=[Where the bus is reachable; repeatable\: all of them are one bus \[default\: socketcand\://127.0.0.1\:29536/pve0\]]:URL:_default' \
'--bit-rate=[The rate of the bus, in bit/s, or as in 250k and 1M \[default\: the rate of the first device\: of a valve 250k, of an angle sensor 500k\]]:N:_default' \
'--speed=[Virtual time against wall time\: a number above 0; or step\: time moves only when the control interface tells it to, and what clients send waits for that]:FACTOR|step:_default' \
'--seed=[The seed of everything random\: 0–18446744073709551615]:N:_default' \
'--log=[Write every frame to FILE\: .asc as ASC, .pcapng as pcapng, all others in the format of candump -L]:FILE:_files' \
'--color=[Colour in the trace\: auto, as the terminal and NO_COLOR have it; always, which lays the trace out as on a terminal into a pipe, too; never]:WHEN:((auto\:"Laid out on a terminal, with colour unless the environment asks for none"
always\:"Laid out with colour, into a pipe, too"
never\:"Laid out on a terminal, without colour"))' \
'(--no-http)--http=[Where the control interface is reachable, port 0 takes a free one \[default\: 127.0.0.1\:8408\]]:ADDR:PORT:_default' \
'--allow-clash[Accept devices with the same node ID, or the same address]' \
'--beacon[Announce the bus by UDP to port 42000, so that python-can and SavvyCAN find it]' \
'--log-overwrite[Write to the file of --log even if it has something in it, which is lost]' \
'--error-frames[Send error frames to clients, too\: the first one, and each change of an error mode]' \
'--verbose[Show every cyclic frame on a terminal, also one that comes again as it was]' \
'--no-http[Serve no control interface]' \
'--allow-remote[Let --http be an address that other machines reach, whoever does can switch everything; and let a bus of udp-multicast reach them]' \
'-h[Print help (see more with '\''--help'\'')]' \
'--help[Print help (see more with '\''--help'\'')]' \
'-V[Print version]' \
'--version[Print version]' \
":: :_pve-sim_commands" \
"*::: :->pve-sim" \
&& ret=0
    case $state in
    (pve-sim)
        words=($line[1] "${words[@]}")
        (( CURRENT += 1 ))
        curcontext="${curcontext%:*:*}:pve-sim-command-$line[1]:"
        case $line[1] in
            (run)
_arguments "${_arguments_options[@]}" : \
'*--device=[A device on the bus; repeatable \[default\: pvea-canopen@0x20\]]:KIND[@ID][,KEY=VALUE…]:_default' \
'*--link=[The shaft of SENSOR follows the spool of VALVE, as a boom that the valve moves; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--state=[Keep each device'\''s memory in DIR/NAME.nvm; without it the memory is lost at exit]:DIR:_files -/' \
'*--bus=[Where the bus is reachable; repeatable\: all of them are one bus \[default\: socketcand\://127.0.0.1\:29536/pve0\]]:URL:_default' \
'--bit-rate=[The rate of the bus, in bit/s, or as in 250k and 1M \[default\: the rate of the first device\: of a valve 250k, of an angle sensor 500k\]]:N:_default' \
'--speed=[Virtual time against wall time\: a number above 0; or step\: time moves only when the control interface tells it to, and what clients send waits for that]:FACTOR|step:_default' \
'--seed=[The seed of everything random\: 0–18446744073709551615]:N:_default' \
'--log=[Write every frame to FILE\: .asc as ASC, .pcapng as pcapng, all others in the format of candump -L]:FILE:_files' \
'--color=[Colour in the trace\: auto, as the terminal and NO_COLOR have it; always, which lays the trace out as on a terminal into a pipe, too; never]:WHEN:((auto\:"Laid out on a terminal, with colour unless the environment asks for none"
always\:"Laid out with colour, into a pipe, too"
never\:"Laid out on a terminal, without colour"))' \
'(--no-http)--http=[Where the control interface is reachable, port 0 takes a free one \[default\: 127.0.0.1\:8408\]]:ADDR:PORT:_default' \
'--allow-clash[Accept devices with the same node ID, or the same address]' \
'--beacon[Announce the bus by UDP to port 42000, so that python-can and SavvyCAN find it]' \
'--log-overwrite[Write to the file of --log even if it has something in it, which is lost]' \
'--error-frames[Send error frames to clients, too\: the first one, and each change of an error mode]' \
'--verbose[Show every cyclic frame on a terminal, also one that comes again as it was]' \
'--no-http[Serve no control interface]' \
'--allow-remote[Let --http be an address that other machines reach, whoever does can switch everything; and let a bus of udp-multicast reach them]' \
'-h[Print help (see more with '\''--help'\'')]' \
'--help[Print help (see more with '\''--help'\'')]' \
&& ret=0
;;
(use-case)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
'::which -- Which one, or all; without it the titles are listed:_default' \
&& ret=0
;;
(scenario)
_arguments "${_arguments_options[@]}" : \
'--junit=[Write the results to FILE as JUnit XML, a test case for each scenario]:FILE:_files' \
'--seed=[The seed of everything random\: 0–18446744073709551615]:N:_default' \
'--verbose[Show all that is on the bus, with the notes of the steps]' \
'--schema[Print the format of a scenario as a JSON schema, for editors]' \
'-h[Print help]' \
'--help[Print help]' \
'*::files -- The scenarios, in the order in which they are told; the format\: docs/scenarios.md:_files' \
&& ret=0
;;
(decode)
_arguments "${_arguments_options[@]}" : \
'*--device=[A device that is known to be on the bus, as for run; repeatable. Without it, the frames tell]:KIND[@ID][,KEY=VALUE…]:_default' \
'-h[Print help]' \
'--help[Print help]' \
':file -- The recording\: candump -L, the screen of candump, ASC or pcapng, by what is in it; - is stdin:_files' \
&& ret=0
;;
(replay)
_arguments "${_arguments_options[@]}" : \
'*--device=[A stand-in that takes the place of a device in the recording, as for run; repeatable]:KIND[@ID][,KEY=VALUE…]:_default' \
'*--link=[The shaft of SENSOR follows the spool of VALVE, as for run; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--tolerance-ms=[How much earlier or later a frame may come, in milliseconds; a position may differ by what is travelled in that time]:N:_default' \
'--from-boot-up[Begin with the first boot-up, or address claim, of a device, and leave out all that is before]' \
'-h[Print help]' \
'--help[Print help]' \
':file -- The recording\: candump -L, the screen of candump with times, ASC or pcapng, by what is in it:_files' \
&& ret=0
;;
(set)
_arguments "${_arguments_options[@]}" : \
'--http=[The control interface of the simulator, as in its ready line]:ADDR:PORT:_default' \
'-h[Print help]' \
'--help[Print help]' \
':device -- The name of the device:_default' \
'*::words -- A plant word and its value, as stdin of the simulator or PATCH /devices/NAME/plant accept them\: supply_mv=8000 spool=stuck lever=off; several words change at the same instant, or none of them:_default' \
&& ret=0
;;
(status)
_arguments "${_arguments_options[@]}" : \
'--http=[The control interface of the simulator, as in its ready line]:ADDR:PORT:_default' \
'--json[Print the answer of GET /devices, or of GET /devices/NAME, as it is]' \
'-h[Print help]' \
'--help[Print help]' \
'::device -- The name of the device; without it, all devices are shown:_default' \
&& ret=0
;;
(eds)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
':sheet -- The kind:_default' \
&& ret=0
;;
(dbc)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
':database -- The kind:_default' \
&& ret=0
;;
(completions)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
':shell -- The shell:(bash elvish fish powershell zsh)' \
&& ret=0
;;
(man)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
&& ret=0
;;
(help)
_arguments "${_arguments_options[@]}" : \
":: :_pve-sim__subcmd__help_commands" \
"*::: :->help" \
&& ret=0

    case $state in
    (help)
        words=($line[1] "${words[@]}")
        (( CURRENT += 1 ))
        curcontext="${curcontext%:*:*}:pve-sim-help-command-$line[1]:"
        case $line[1] in
            (run)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(use-case)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(scenario)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(decode)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(replay)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(set)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(status)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(eds)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(dbc)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(completions)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(man)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
(help)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
        esac
    ;;
esac
;;
        esac
    ;;
esac
}

(( $+functions[_pve-sim_commands] )) ||
_pve-sim_commands() {
    local commands; commands=(
'run:A stand-in device, or several, on a bus (the default command)' \
'use-case:Plays the manuals'\'' use cases, a valve on ISOBUS or an angle sensor in virtual time, each frame with what it means; exit 1 if any frame differs' \
'scenario:Runs scenarios from files in virtual time\: devices, what happens to them, what has to come of it; exit 1 if an expectation fails, 2 before anything runs if a file cannot be read' \
'decode:Explains a recorded log line by line, as the trace does; exit 1 if a line is none' \
'replay:Plays a recorded log against stand-ins, from their power-up and in virtual time\: what they send is compared with the log, all else is sent to them; exit 1 on differences' \
'set:Changes what a device of a running simulator senses, as lines on its stdin do; exit 1 if the simulator refuses the change or cannot be reached' \
'status:Prints the states of the devices of a running simulator; exit 1 if it has no such device or cannot be reached' \
'eds:Prints the EDS of a CANopen kind, from its object dictionary' \
'dbc:Prints the DBC of an ISOBUS kind, with its messages at each address' \
'completions:Prints the completion script for a shell' \
'man:Prints the manual page, in roff' \
'help:Print this message or the help of the given subcommand(s)' \
    )
    _describe -t commands 'pve-sim commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__completions_commands] )) ||
_pve-sim__subcmd__completions_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim completions commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__dbc_commands] )) ||
_pve-sim__subcmd__dbc_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim dbc commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__decode_commands] )) ||
_pve-sim__subcmd__decode_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim decode commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__eds_commands] )) ||
_pve-sim__subcmd__eds_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim eds commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help_commands] )) ||
_pve-sim__subcmd__help_commands() {
    local commands; commands=(
'run:A stand-in device, or several, on a bus (the default command)' \
'use-case:Plays the manuals'\'' use cases, a valve on ISOBUS or an angle sensor in virtual time, each frame with what it means; exit 1 if any frame differs' \
'scenario:Runs scenarios from files in virtual time\: devices, what happens to them, what has to come of it; exit 1 if an expectation fails, 2 before anything runs if a file cannot be read' \
'decode:Explains a recorded log line by line, as the trace does; exit 1 if a line is none' \
'replay:Plays a recorded log against stand-ins, from their power-up and in virtual time\: what they send is compared with the log, all else is sent to them; exit 1 on differences' \
'set:Changes what a device of a running simulator senses, as lines on its stdin do; exit 1 if the simulator refuses the change or cannot be reached' \
'status:Prints the states of the devices of a running simulator; exit 1 if it has no such device or cannot be reached' \
'eds:Prints the EDS of a CANopen kind, from its object dictionary' \
'dbc:Prints the DBC of an ISOBUS kind, with its messages at each address' \
'completions:Prints the completion script for a shell' \
'man:Prints the manual page, in roff' \
'help:Print this message or the help of the given subcommand(s)' \
    )
    _describe -t commands 'pve-sim help commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__completions_commands] )) ||
_pve-sim__subcmd__help__subcmd__completions_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help completions commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__dbc_commands] )) ||
_pve-sim__subcmd__help__subcmd__dbc_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help dbc commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__decode_commands] )) ||
_pve-sim__subcmd__help__subcmd__decode_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help decode commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__eds_commands] )) ||
_pve-sim__subcmd__help__subcmd__eds_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help eds commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__help_commands] )) ||
_pve-sim__subcmd__help__subcmd__help_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help help commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__man_commands] )) ||
_pve-sim__subcmd__help__subcmd__man_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help man commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__replay_commands] )) ||
_pve-sim__subcmd__help__subcmd__replay_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help replay commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__run_commands] )) ||
_pve-sim__subcmd__help__subcmd__run_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help run commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__scenario_commands] )) ||
_pve-sim__subcmd__help__subcmd__scenario_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help scenario commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__set_commands] )) ||
_pve-sim__subcmd__help__subcmd__set_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help set commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__status_commands] )) ||
_pve-sim__subcmd__help__subcmd__status_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help status commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__use-case_commands] )) ||
_pve-sim__subcmd__help__subcmd__use-case_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help use-case commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__man_commands] )) ||
_pve-sim__subcmd__man_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim man commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__replay_commands] )) ||
_pve-sim__subcmd__replay_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim replay commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__run_commands] )) ||
_pve-sim__subcmd__run_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim run commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__scenario_commands] )) ||
_pve-sim__subcmd__scenario_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim scenario commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__set_commands] )) ||
_pve-sim__subcmd__set_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim set commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__status_commands] )) ||
_pve-sim__subcmd__status_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim status commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__use-case_commands] )) ||
_pve-sim__subcmd__use-case_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim use-case commands' commands "$@"
}

if [ "$funcstack[1]" = "_pve-sim" ]; then
    _pve-sim "$@"
else
    compdef _pve-sim pve-sim
fi
