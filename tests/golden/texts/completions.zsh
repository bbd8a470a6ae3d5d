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
'*--link=[Make the shaft of SENSOR follow the spool of VALVE, as on a boom that the valve moves; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--state=[Keep each device'\''s memory in DIR/NAME.nvm; without it, the memory is lost at exit]:DIR:_files -/' \
'*--bus=[The URL of the bus; repeatable, all URLs share one bus \[default\: socketcand\://127.0.0.1\:29536/pve0\]]:URL:_default' \
'--bit-rate=[The bit rate of the bus, in bit/s, or as in 250k and 1M \[default\: that of the first device, by default 250k for a valve and 500k for an angle sensor\]]:N:_default' \
'--speed=[The speed of virtual time\: a factor of wall time, above 0; or step\: only the control interface advances time, and client frames wait until it does]:FACTOR|step:_default' \
'--seed=[The seed of all random values\: 0–18446744073709551615]:N:_default' \
'--log=[Write every frame to FILE\: .asc as ASC, .pcapng as pcapng, all others in the format of candump -L]:FILE:_files' \
'--color=[Colour in the trace\: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a pipe) or never]:WHEN:((auto\:"Laid out on a terminal, with colour unless the environment disables it"
always\:"Laid out with colour, even into a pipe"
never\:"Laid out on a terminal, without colour"))' \
'(--no-http)--http=[The address of the control interface, port 0 selects a free one \[default\: 127.0.0.1\:8408\]]:ADDR:PORT:_default' \
'--allow-clash[Accept devices with the same node ID, or the same address]' \
'--beacon[Announce the bus by UDP to port 42000, so that python-can and SavvyCAN find it]' \
'--allow-real-bus[Allow communication faults on socketcan\:, where real devices may be; without it, only the simulated devices can lose frames]' \
'--log-overwrite[Overwrite the --log file if it is not empty]' \
'--error-frames[Send error frames to clients\: the first one, and one per change of an error mode]' \
'--verbose[Show every cyclic frame on a terminal, including unchanged repeats]' \
'--no-http[Disable the control interface]' \
'--allow-remote[Allow --http to listen at an address that other machines can reach, which gives them full control; and allow a udp-multicast bus to reach them]' \
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
'*--link=[Make the shaft of SENSOR follow the spool of VALVE, as on a boom that the valve moves; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--state=[Keep each device'\''s memory in DIR/NAME.nvm; without it, the memory is lost at exit]:DIR:_files -/' \
'*--bus=[The URL of the bus; repeatable, all URLs share one bus \[default\: socketcand\://127.0.0.1\:29536/pve0\]]:URL:_default' \
'--bit-rate=[The bit rate of the bus, in bit/s, or as in 250k and 1M \[default\: that of the first device, by default 250k for a valve and 500k for an angle sensor\]]:N:_default' \
'--speed=[The speed of virtual time\: a factor of wall time, above 0; or step\: only the control interface advances time, and client frames wait until it does]:FACTOR|step:_default' \
'--seed=[The seed of all random values\: 0–18446744073709551615]:N:_default' \
'--log=[Write every frame to FILE\: .asc as ASC, .pcapng as pcapng, all others in the format of candump -L]:FILE:_files' \
'--color=[Colour in the trace\: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a pipe) or never]:WHEN:((auto\:"Laid out on a terminal, with colour unless the environment disables it"
always\:"Laid out with colour, even into a pipe"
never\:"Laid out on a terminal, without colour"))' \
'(--no-http)--http=[The address of the control interface, port 0 selects a free one \[default\: 127.0.0.1\:8408\]]:ADDR:PORT:_default' \
'--allow-clash[Accept devices with the same node ID, or the same address]' \
'--beacon[Announce the bus by UDP to port 42000, so that python-can and SavvyCAN find it]' \
'--allow-real-bus[Allow communication faults on socketcan\:, where real devices may be; without it, only the simulated devices can lose frames]' \
'--log-overwrite[Overwrite the --log file if it is not empty]' \
'--error-frames[Send error frames to clients\: the first one, and one per change of an error mode]' \
'--verbose[Show every cyclic frame on a terminal, including unchanged repeats]' \
'--no-http[Disable the control interface]' \
'--allow-remote[Allow --http to listen at an address that other machines can reach, which gives them full control; and allow a udp-multicast bus to reach them]' \
'-h[Print help (see more with '\''--help'\'')]' \
'--help[Print help (see more with '\''--help'\'')]' \
&& ret=0
;;
(use-case)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
'::which -- The use case, or all; if omitted, the titles are listed:_default' \
&& ret=0
;;
(scenario)
_arguments "${_arguments_options[@]}" : \
'--junit=[Write the results to FILE as JUnit XML, a test case for each scenario]:FILE:_files' \
'--seed=[The seed of all random values\: 0–18446744073709551615]:N:_default' \
'--verbose[Print the traces, with the step notes]' \
'--schema[Print the format of a scenario as a JSON schema, for editors]' \
'-h[Print help]' \
'--help[Print help]' \
'*::files -- The scenarios, in the order of the report; the format\: docs/scenarios.md:_files' \
&& ret=0
;;
(decode)
_arguments "${_arguments_options[@]}" : \
'*--device=[A device known to be on the bus, as for run; repeatable. Without it, devices are detected by their frames]:KIND[@ID][,KEY=VALUE…]:_default' \
'-h[Print help]' \
'--help[Print help]' \
':file -- The recording\: a candump -L log, a candump screen, ASC or pcapng, detected by its content; - is stdin:_files' \
&& ret=0
;;
(replay)
_arguments "${_arguments_options[@]}" : \
'*--device=[A simulated device that replaces one in the recording, as for run; repeatable]:KIND[@ID][,KEY=VALUE…]:_default' \
'*--link=[Make the shaft of SENSOR follow the spool of VALVE, as for run; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--tolerance-ms=[The tolerance of frame times, in milliseconds; a position may differ by the movement within that time]:N:_default' \
'--from-boot-up[Begin with the first boot-up or address claim of a device, and ignore all earlier frames]' \
'-h[Print help]' \
'--help[Print help]' \
':file -- The recording\: a candump -L log, a candump screen with times, ASC or pcapng, detected by its content:_files' \
&& ret=0
;;
(set)
_arguments "${_arguments_options[@]}" : \
'--http=[The control interface of the simulator, as in its ready line]:ADDR:PORT:_default' \
'-h[Print help]' \
'--help[Print help]' \
':device -- The name of the device:_default' \
'*::words -- A plant word and its value, as on the console or in PATCH /devices/NAME/plant\: supply_mv=8000 spool=stuck lever=off; several words change at the same instant, or none changes:_default' \
&& ret=0
;;
(status)
_arguments "${_arguments_options[@]}" : \
'--http=[The control interface of the simulator, as in its ready line]:ADDR:PORT:_default' \
'--json[Print the JSON of GET /devices or GET /devices/NAME]' \
'-h[Print help]' \
'--help[Print help]' \
'::device -- The name of the device; without it, all devices are shown:_default' \
&& ret=0
;;
(eds)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
':sheet -- The kind of device:_default' \
&& ret=0
;;
(dbc)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
':database -- The kind of device:_default' \
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
'run:Runs devices on a bus (the default command)' \
'use-case:Plays the use cases of the manuals, of an ISOBUS valve or of an angle sensor, in virtual time and explains each frame; exit 1 if a frame differs' \
'scenario:Runs scenario files in virtual time\: devices, actions and expectations; exit 1 if an expectation fails, 2 before anything runs if a file cannot be read' \
'decode:Explains each line of a recorded log, as the trace does; exit 1 if a line cannot be parsed' \
'replay:Replays a recorded log against simulated devices, from their power-up, in virtual time\: compares their frames with the log and sends them all other frames; exit 1 on differences' \
'set:Changes the plant of a device in a running simulator, as its console does; exit 1 if the simulator refuses the change or cannot be reached' \
'status:Prints the states of the devices in a running simulator; exit 1 if the device does not exist or the simulator cannot be reached' \
'eds:Prints the EDS of a CANopen kind, generated from its object dictionary' \
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
'run:Runs devices on a bus (the default command)' \
'use-case:Plays the use cases of the manuals, of an ISOBUS valve or of an angle sensor, in virtual time and explains each frame; exit 1 if a frame differs' \
'scenario:Runs scenario files in virtual time\: devices, actions and expectations; exit 1 if an expectation fails, 2 before anything runs if a file cannot be read' \
'decode:Explains each line of a recorded log, as the trace does; exit 1 if a line cannot be parsed' \
'replay:Replays a recorded log against simulated devices, from their power-up, in virtual time\: compares their frames with the log and sends them all other frames; exit 1 on differences' \
'set:Changes the plant of a device in a running simulator, as its console does; exit 1 if the simulator refuses the change or cannot be reached' \
'status:Prints the states of the devices in a running simulator; exit 1 if the device does not exist or the simulator cannot be reached' \
'eds:Prints the EDS of a CANopen kind, generated from its object dictionary' \
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
