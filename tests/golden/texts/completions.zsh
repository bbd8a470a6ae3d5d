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
'*--link=[Let the spool of VALVE turn the shaft of SENSOR, as on a boom; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--state=[Keep the memory of each device in DIR/NAME.nvm; without this option, the memory is lost at exit]:DIR:_files -/' \
'*--bus=[A URL at which clients reach the bus; repeatable \[default\: socketcand\://127.0.0.1\:29536/pve0\]]:URL:_default' \
'--bit-rate=[The bit rate of the bus in bit/s, or with k or M, as in 250k \[default\: the rate of the first device, by default 250k for a valve and 500k for an angle sensor\]]:N:_default' \
'--speed=[The speed of virtual time\: a factor of wall time above 0, or step\: only the control interface advances time, and the frames of clients wait for the next advance]:FACTOR|step:_default' \
'--seed=[The seed of all random values\: 0–18446744073709551615]:N:_default' \
'--log=[Write every frame to FILE, in the format of its extension\: .asc (ASC), .pcapng (pcapng), any other (candump -L)]:FILE:_files' \
'--color=[Colour in the trace\: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a pipe) or never]:WHEN:((auto\:"The layout on a terminal only, with colour unless the environment disables colour"
always\:"The layout everywhere, even in a pipe, with colour"
never\:"The layout on a terminal only, without colour"))' \
'(--no-http)--http=[The address of the control interface; port 0 selects a free port \[default\: 127.0.0.1\:8408\]]:ADDR:PORT:_default' \
'(--device --link --bit-rate --state --seed --allow-clash --no-http)--plan=[Run the devices of a campaign'\''s scenario, inject the fault of a cell and judge the controller\: docs/campaigns.md]:PLAN.toml:_files' \
'--cell=[The cell\: its number, or ROW@MICROSECONDS]:CELL:_default' \
'--plan-seed=[Replace the seeds of the plan with one seed]:N:_default' \
'--allow-clash[Accept devices with the same node ID, or the same address]' \
'--beacon[Announce socketcand buses by UDP to port 42000, so that python-can and SavvyCAN can find them]' \
'--allow-real-bus[Allow communication faults with --bus socketcan\:, where they can affect real devices; without this option, only simulated devices can lose frames]' \
'--log-overwrite[Overwrite the --log file if it is not empty]' \
'--error-frames[Send error frames to clients\: the first one of each destroyed frame, and one for each change of an error mode]' \
'--verbose[Show every cyclic frame on a terminal, including unchanged repeats]' \
'--no-http[Disable the control interface]' \
'--allow-remote[Allow an --http address that other machines can reach, which gives them full control, and allow a udp-multicast bus to reach other machines]' \
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
'*--link=[Let the spool of VALVE turn the shaft of SENSOR, as on a boom; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--state=[Keep the memory of each device in DIR/NAME.nvm; without this option, the memory is lost at exit]:DIR:_files -/' \
'*--bus=[A URL at which clients reach the bus; repeatable \[default\: socketcand\://127.0.0.1\:29536/pve0\]]:URL:_default' \
'--bit-rate=[The bit rate of the bus in bit/s, or with k or M, as in 250k \[default\: the rate of the first device, by default 250k for a valve and 500k for an angle sensor\]]:N:_default' \
'--speed=[The speed of virtual time\: a factor of wall time above 0, or step\: only the control interface advances time, and the frames of clients wait for the next advance]:FACTOR|step:_default' \
'--seed=[The seed of all random values\: 0–18446744073709551615]:N:_default' \
'--log=[Write every frame to FILE, in the format of its extension\: .asc (ASC), .pcapng (pcapng), any other (candump -L)]:FILE:_files' \
'--color=[Colour in the trace\: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a pipe) or never]:WHEN:((auto\:"The layout on a terminal only, with colour unless the environment disables colour"
always\:"The layout everywhere, even in a pipe, with colour"
never\:"The layout on a terminal only, without colour"))' \
'(--no-http)--http=[The address of the control interface; port 0 selects a free port \[default\: 127.0.0.1\:8408\]]:ADDR:PORT:_default' \
'(--device --link --bit-rate --state --seed --allow-clash --no-http)--plan=[Run the devices of a campaign'\''s scenario, inject the fault of a cell and judge the controller\: docs/campaigns.md]:PLAN.toml:_files' \
'--cell=[The cell\: its number, or ROW@MICROSECONDS]:CELL:_default' \
'--plan-seed=[Replace the seeds of the plan with one seed]:N:_default' \
'--allow-clash[Accept devices with the same node ID, or the same address]' \
'--beacon[Announce socketcand buses by UDP to port 42000, so that python-can and SavvyCAN can find them]' \
'--allow-real-bus[Allow communication faults with --bus socketcan\:, where they can affect real devices; without this option, only simulated devices can lose frames]' \
'--log-overwrite[Overwrite the --log file if it is not empty]' \
'--error-frames[Send error frames to clients\: the first one of each destroyed frame, and one for each change of an error mode]' \
'--verbose[Show every cyclic frame on a terminal, including unchanged repeats]' \
'--no-http[Disable the control interface]' \
'--allow-remote[Allow an --http address that other machines can reach, which gives them full control, and allow a udp-multicast bus to reach other machines]' \
'-h[Print help (see more with '\''--help'\'')]' \
'--help[Print help (see more with '\''--help'\'')]' \
&& ret=0
;;
(use-case)
_arguments "${_arguments_options[@]}" : \
'-h[Print help]' \
'--help[Print help]' \
'::which -- The use case, or all; without it, the titles are listed:_default' \
&& ret=0
;;
(scenario)
_arguments "${_arguments_options[@]}" : \
'--junit=[Write the results to FILE as JUnit XML, with a test case for each scenario]:FILE:_files' \
'--seed=[The seed of all random values\: 0–18446744073709551615]:N:_default' \
'--verbose[Print the trace of each scenario, with the notes of its steps]' \
'--schema[Print the format of a scenario as a JSON schema, for editors]' \
'-h[Print help]' \
'--help[Print help]' \
'*::files -- The scenario files, in the order of the report; docs/scenarios.md describes their format:_files' \
&& ret=0
;;
(campaign)
_arguments "${_arguments_options[@]}" : \
'--seed=[Replace the seeds of the plan with one seed\: 0–18446744073709551615]:N:_default' \
'--jobs=[Run N rows at once \[default\: the number of processors\]]:N:_default' \
'--shard=[Run part K of N; \`pve-sim campaign merge\` joins the results]:K/N:_default' \
'(--jobs --shard --resume --no-fork --results --html --csv --json --junit)--cell=[Run one cell alone, given by its number or ROW@MICROSECONDS, and print its explained trace]:CELL:_default' \
'(--cell --list --shard --resume --no-fork --results --html --csv --json --junit)--explore=[Search for pairs of faults that fail together only, for this time\: 1–86400. --seed is the seed of the search]:SECONDS:_default' \
'--finds=[The folder for the scenarios of --explore, PLAN.find-N.toml \[default\: the current folder\]]:DIR:_files -/' \
'--results=[The results file, one JSON value per line \[default\: PLAN.results.jsonl, in the current folder\]]:FILE:_files' \
'--html=[Write an HTML page with the matrix, reaction times and traces to FILE]:FILE:_files' \
'--csv=[Write the results to FILE as CSV, a line for each cell]:FILE:_files' \
'--json=[Write all results to FILE as one JSON document]:FILE:_files' \
'--junit=[Write the results to FILE as JUnit XML, a test case for each fault]:FILE:_files' \
'--resume[Keep the complete rows in the results file, and run the others]' \
'--no-fork[Run each cell from 0 ms instead of from a copy of the run without a fault; the verdicts are the same]' \
'(--cell --jobs --shard --resume --no-fork --results --html --csv --json --junit)--list[Print the cells of the grid, one JSON value per line, and run none]' \
'--schema[Print the format of a plan as a JSON schema, for editors]' \
'-h[Print help]' \
'--help[Print help]' \
'::plan -- The plan; docs/campaigns.md describes its format:_files' \
":: :_pve-sim__subcmd__campaign_commands" \
"*::: :->campaign" \
&& ret=0

    case $state in
    (campaign)
        words=($line[2] "${words[@]}")
        (( CURRENT += 1 ))
        curcontext="${curcontext%:*:*}:pve-sim-campaign-command-$line[2]:"
        case $line[2] in
            (merge)
_arguments "${_arguments_options[@]}" : \
'--results=[Write the joined results to FILE]:FILE:_files' \
'--html=[Write an HTML page with the matrix, reaction times and traces to FILE]:FILE:_files' \
'--csv=[Write the results to FILE as CSV, a line for each cell]:FILE:_files' \
'--json=[Write all results to FILE as one JSON document]:FILE:_files' \
'--junit=[Write the results to FILE as JUnit XML, a test case for each fault]:FILE:_files' \
'-h[Print help]' \
'--help[Print help]' \
'*::files -- The results files of the shards:_files' \
&& ret=0
;;
        esac
    ;;
esac
;;
(decode)
_arguments "${_arguments_options[@]}" : \
'*--device=[A device on the bus, as for run; repeatable. Without this option, devices are recognised by their frames]:KIND[@ID][,KEY=VALUE…]:_default' \
'-h[Print help]' \
'--help[Print help]' \
':file -- The recording, or - for stdin; its format is detected\: candump -L, screen output of candump, ASC or pcapng:_files' \
&& ret=0
;;
(replay)
_arguments "${_arguments_options[@]}" : \
'*--device=[A simulated device that replaces a recorded device, as for run; repeatable]:KIND[@ID][,KEY=VALUE…]:_default' \
'*--link=[Let the spool of VALVE turn the shaft of SENSOR, as for run; repeatable]:VALVE=SENSOR[,KEY=VALUE…]:_default' \
'--tolerance-ms=[The tolerance of frame times, in milliseconds; a position may differ by the movement in that time]:N:_default' \
'--seed=[The seed of all random values, as for run\: 0–18446744073709551615]:N:_default' \
'--from-boot-up[Begin with the first boot-up or address claim of a device; earlier frames are ignored]' \
'-h[Print help]' \
'--help[Print help]' \
':file -- The recording; its format is detected\: candump -L, screen output of candump with times, ASC or pcapng:_files' \
&& ret=0
;;
(set)
_arguments "${_arguments_options[@]}" : \
'--http=[The address of the control interface, as in the ready line of the simulator]:ADDR:PORT:_default' \
'-h[Print help]' \
'--help[Print help]' \
':device -- The name of the device:_default' \
'*::words -- A plant word and its value, as on the console or in PATCH /devices/NAME/plant, for example supply_mv=8000 spool=stuck lever=off; all words change at the same instant, or none does:_default' \
&& ret=0
;;
(status)
_arguments "${_arguments_options[@]}" : \
'--http=[The address of the control interface, as in the ready line of the simulator]:ADDR:PORT:_default' \
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
(campaign)
_arguments "${_arguments_options[@]}" : \
":: :_pve-sim__subcmd__help__subcmd__campaign_commands" \
"*::: :->campaign" \
&& ret=0

    case $state in
    (campaign)
        words=($line[1] "${words[@]}")
        (( CURRENT += 1 ))
        curcontext="${curcontext%:*:*}:pve-sim-help-campaign-command-$line[1]:"
        case $line[1] in
            (merge)
_arguments "${_arguments_options[@]}" : \
&& ret=0
;;
        esac
    ;;
esac
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
'use-case:Plays a use case (of the manuals, an ISOBUS valve or an angle sensor) in virtual time, and explains each frame; exit 1 if a frame differs' \
'scenario:Runs scenario files in virtual time\: devices, actions and expectations; exit 1 if a scenario fails; exit 2, without running any, if a file cannot be read' \
'campaign:Injects each fault of a plan at each instant of a scenario, in virtual time, and judges the reaction of the controller; exit 1 if a limit is broken; exit 2, without running anything, if the plan cannot be read' \
'decode:Explains each line of a recording, as the trace does; exit 1 if a line cannot be parsed' \
'replay:Replays a recording against simulated devices in virtual time\: compares their frames with the recording, and sends them all other frames; exit 1 on differences' \
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
(( $+functions[_pve-sim__subcmd__campaign_commands] )) ||
_pve-sim__subcmd__campaign_commands() {
    local commands; commands=(
'merge:Joins the results of shards, and reports them; exit 1 if a limit is broken or a row is missing' \
    )
    _describe -t commands 'pve-sim campaign commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__campaign__subcmd__merge_commands] )) ||
_pve-sim__subcmd__campaign__subcmd__merge_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim campaign merge commands' commands "$@"
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
'use-case:Plays a use case (of the manuals, an ISOBUS valve or an angle sensor) in virtual time, and explains each frame; exit 1 if a frame differs' \
'scenario:Runs scenario files in virtual time\: devices, actions and expectations; exit 1 if a scenario fails; exit 2, without running any, if a file cannot be read' \
'campaign:Injects each fault of a plan at each instant of a scenario, in virtual time, and judges the reaction of the controller; exit 1 if a limit is broken; exit 2, without running anything, if the plan cannot be read' \
'decode:Explains each line of a recording, as the trace does; exit 1 if a line cannot be parsed' \
'replay:Replays a recording against simulated devices in virtual time\: compares their frames with the recording, and sends them all other frames; exit 1 on differences' \
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
(( $+functions[_pve-sim__subcmd__help__subcmd__campaign_commands] )) ||
_pve-sim__subcmd__help__subcmd__campaign_commands() {
    local commands; commands=(
'merge:Joins the results of shards, and reports them; exit 1 if a limit is broken or a row is missing' \
    )
    _describe -t commands 'pve-sim help campaign commands' commands "$@"
}
(( $+functions[_pve-sim__subcmd__help__subcmd__campaign__subcmd__merge_commands] )) ||
_pve-sim__subcmd__help__subcmd__campaign__subcmd__merge_commands() {
    local commands; commands=()
    _describe -t commands 'pve-sim help campaign merge commands' commands "$@"
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
