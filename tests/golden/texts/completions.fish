# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_pve_sim_global_optspecs
    string join \n device= link= allow-clash state= bus= beacon allow-real-bus bit-rate= speed= seed= log= log-overwrite error-frames color= verbose http= no-http allow-remote plan= cell= plan-seed= h/help V/version
end

function __fish_pve_sim_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_pve_sim_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_pve_sim_using_subcommand
    set -l cmd (__fish_pve_sim_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c pve-sim -n "__fish_pve_sim_needs_command" -l device -d 'A device on the bus; repeatable [default: pvea-canopen@0x20]' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l link -d 'Let the spool of VALVE turn the shaft of SENSOR, as on a boom; repeatable' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l state -d 'Keep the memory of each device in DIR/NAME.nvm; without this option, the memory is lost at exit' -r -f -a "(__fish_complete_directories)"
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l bus -d 'A URL at which clients reach the bus; repeatable [default: socketcand://127.0.0.1:29536/pve0]' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l bit-rate -d 'The bit rate of the bus in bit/s, or with k or M, as in 250k [default: the rate of the first device, by default 250k for a valve and 500k for an angle sensor]' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l speed -d 'The speed of virtual time: a factor of wall time above 0, or step: only the control interface advances time, and the frames of clients wait for the next advance' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l seed -d 'The seed of all random values: 0–18446744073709551615' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l log -d 'Write every frame to FILE, in the format of its extension: .asc (ASC), .pcapng (pcapng), any other (candump -L)' -r -F
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l color -d 'Colour in the trace: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a pipe) or never' -r -f -a "auto\t'The layout on a terminal only, with colour unless the environment disables colour'
always\t'The layout everywhere, even in a pipe, with colour'
never\t'The layout on a terminal only, without colour'"
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l http -d 'The address of the control interface; port 0 selects a free port [default: 127.0.0.1:8408]' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l plan -d 'Run the devices of a campaign\'s scenario, inject the fault of a cell and judge the controller: docs/campaigns.md' -r -F
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l cell -d 'The cell: its number, or ROW@MICROSECONDS' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l plan-seed -d 'Replace the seeds of the plan with one seed' -r
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l allow-clash -d 'Accept devices with the same node ID, or the same address'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l beacon -d 'Announce socketcand buses by UDP to port 42000, so that python-can and SavvyCAN can find them'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l allow-real-bus -d 'Allow communication faults with --bus socketcan:, where they can affect real devices; without this option, only simulated devices can lose frames'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l log-overwrite -d 'Overwrite the --log file if it is not empty'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l error-frames -d 'Send error frames to clients: the first one of each destroyed frame, and one for each change of an error mode'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l verbose -d 'Show every cyclic frame on a terminal, including unchanged repeats'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l no-http -d 'Disable the control interface'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -l allow-remote -d 'Allow an --http address that other machines can reach, which gives them full control, and allow a udp-multicast bus to reach other machines'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -s V -l version -d 'Print version'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "run" -d 'Runs devices on a bus (the default command)'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "use-case" -d 'Plays a use case (of the manuals, an ISOBUS valve or an angle sensor) in virtual time, and explains each frame; exit 1 if a frame differs'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "scenario" -d 'Runs scenario files in virtual time: devices, actions and expectations; exit 1 if a scenario fails; exit 2, without running any, if a file cannot be read'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "campaign" -d 'Injects each fault of a plan at each instant of a scenario, in virtual time, and judges the reaction of the controller; exit 1 if a limit is broken; exit 2, without running anything, if the plan cannot be read'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "decode" -d 'Explains each line of a recording, as the trace does; exit 1 if a line cannot be parsed'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "replay" -d 'Replays a recording against simulated devices in virtual time: compares their frames with the recording, and sends them all other frames; exit 1 on differences'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "set" -d 'Changes the plant of a device in a running simulator, as its console does; exit 1 if the simulator refuses the change or cannot be reached'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "status" -d 'Prints the states of the devices in a running simulator; exit 1 if the device does not exist or the simulator cannot be reached'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "eds" -d 'Prints the EDS of a CANopen kind, generated from its object dictionary'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "dbc" -d 'Prints the DBC of an ISOBUS kind, with its messages at each address'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "completions" -d 'Prints the completion script for a shell'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "man" -d 'Prints the manual page, in roff'
complete -c pve-sim -n "__fish_pve_sim_needs_command" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l device -d 'A device on the bus; repeatable [default: pvea-canopen@0x20]' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l link -d 'Let the spool of VALVE turn the shaft of SENSOR, as on a boom; repeatable' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l state -d 'Keep the memory of each device in DIR/NAME.nvm; without this option, the memory is lost at exit' -r -f -a "(__fish_complete_directories)"
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l bus -d 'A URL at which clients reach the bus; repeatable [default: socketcand://127.0.0.1:29536/pve0]' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l bit-rate -d 'The bit rate of the bus in bit/s, or with k or M, as in 250k [default: the rate of the first device, by default 250k for a valve and 500k for an angle sensor]' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l speed -d 'The speed of virtual time: a factor of wall time above 0, or step: only the control interface advances time, and the frames of clients wait for the next advance' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l seed -d 'The seed of all random values: 0–18446744073709551615' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l log -d 'Write every frame to FILE, in the format of its extension: .asc (ASC), .pcapng (pcapng), any other (candump -L)' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l color -d 'Colour in the trace: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a pipe) or never' -r -f -a "auto\t'The layout on a terminal only, with colour unless the environment disables colour'
always\t'The layout everywhere, even in a pipe, with colour'
never\t'The layout on a terminal only, without colour'"
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l http -d 'The address of the control interface; port 0 selects a free port [default: 127.0.0.1:8408]' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l plan -d 'Run the devices of a campaign\'s scenario, inject the fault of a cell and judge the controller: docs/campaigns.md' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l cell -d 'The cell: its number, or ROW@MICROSECONDS' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l plan-seed -d 'Replace the seeds of the plan with one seed' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l allow-clash -d 'Accept devices with the same node ID, or the same address'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l beacon -d 'Announce socketcand buses by UDP to port 42000, so that python-can and SavvyCAN can find them'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l allow-real-bus -d 'Allow communication faults with --bus socketcan:, where they can affect real devices; without this option, only simulated devices can lose frames'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l log-overwrite -d 'Overwrite the --log file if it is not empty'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l error-frames -d 'Send error frames to clients: the first one of each destroyed frame, and one for each change of an error mode'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l verbose -d 'Show every cyclic frame on a terminal, including unchanged repeats'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l no-http -d 'Disable the control interface'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -l allow-remote -d 'Allow an --http address that other machines can reach, which gives them full control, and allow a udp-multicast bus to reach other machines'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand run" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand use-case" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand scenario" -l junit -d 'Write the results to FILE as JUnit XML, with a test case for each scenario' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand scenario" -l seed -d 'The seed of all random values: 0–18446744073709551615' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand scenario" -l verbose -d 'Print the trace of each scenario, with the notes of its steps'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand scenario" -l schema -d 'Print the format of a scenario as a JSON schema, for editors'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand scenario" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l seed -d 'Replace the seeds of the plan with one seed: 0–18446744073709551615' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l jobs -d 'Run N rows at once [default: the number of processors]' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l shard -d 'Run part K of N; `pve-sim campaign merge` joins the results' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l cell -d 'Run one cell alone, given by its number or ROW@MICROSECONDS, and print its explained trace' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l explore -d 'Search for pairs of faults that fail together only, for this time: 1–86400. --seed is the seed of the search' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l finds -d 'The folder for the scenarios of --explore, PLAN.find-N.toml [default: the current folder]' -r -f -a "(__fish_complete_directories)"
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l results -d 'The results file, one JSON value per line [default: PLAN.results.jsonl, in the current folder]' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l html -d 'Write an HTML page with the matrix, reaction times and traces to FILE' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l csv -d 'Write the results to FILE as CSV, a line for each cell' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l json -d 'Write all results to FILE as one JSON document' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l junit -d 'Write the results to FILE as JUnit XML, a test case for each fault' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l resume -d 'Keep the complete rows in the results file, and run the others'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l no-fork -d 'Run each cell from 0 ms instead of from a copy of the run without a fault; the verdicts are the same'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l list -d 'Print the cells of the grid, one JSON value per line, and run none'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -l schema -d 'Print the format of a plan as a JSON schema, for editors'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and not __fish_seen_subcommand_from merge" -a "merge" -d 'Joins the results of shards, and reports them; exit 1 if a limit is broken or a row is missing'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and __fish_seen_subcommand_from merge" -l results -d 'Write the joined results to FILE' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and __fish_seen_subcommand_from merge" -l html -d 'Write an HTML page with the matrix, reaction times and traces to FILE' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and __fish_seen_subcommand_from merge" -l csv -d 'Write the results to FILE as CSV, a line for each cell' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and __fish_seen_subcommand_from merge" -l json -d 'Write all results to FILE as one JSON document' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and __fish_seen_subcommand_from merge" -l junit -d 'Write the results to FILE as JUnit XML, a test case for each fault' -r -F
complete -c pve-sim -n "__fish_pve_sim_using_subcommand campaign; and __fish_seen_subcommand_from merge" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand decode" -l device -d 'A device on the bus, as for run; repeatable. Without this option, devices are recognised by their frames' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand decode" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand replay" -l device -d 'A simulated device that replaces a recorded device, as for run; repeatable' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand replay" -l link -d 'Let the spool of VALVE turn the shaft of SENSOR, as for run; repeatable' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand replay" -l tolerance-ms -d 'The tolerance of frame times, in milliseconds; a position may differ by the movement in that time' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand replay" -l seed -d 'The seed of all random values, as for run: 0–18446744073709551615' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand replay" -l from-boot-up -d 'Begin with the first boot-up or address claim of a device; earlier frames are ignored'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand replay" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand set" -l http -d 'The address of the control interface, as in the ready line of the simulator' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand set" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand status" -l http -d 'The address of the control interface, as in the ready line of the simulator' -r
complete -c pve-sim -n "__fish_pve_sim_using_subcommand status" -l json -d 'Print the JSON of GET /devices or GET /devices/NAME'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand status" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand eds" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand dbc" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand completions" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand man" -s h -l help -d 'Print help'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "run" -d 'Runs devices on a bus (the default command)'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "use-case" -d 'Plays a use case (of the manuals, an ISOBUS valve or an angle sensor) in virtual time, and explains each frame; exit 1 if a frame differs'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "scenario" -d 'Runs scenario files in virtual time: devices, actions and expectations; exit 1 if a scenario fails; exit 2, without running any, if a file cannot be read'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "campaign" -d 'Injects each fault of a plan at each instant of a scenario, in virtual time, and judges the reaction of the controller; exit 1 if a limit is broken; exit 2, without running anything, if the plan cannot be read'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "decode" -d 'Explains each line of a recording, as the trace does; exit 1 if a line cannot be parsed'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "replay" -d 'Replays a recording against simulated devices in virtual time: compares their frames with the recording, and sends them all other frames; exit 1 on differences'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "set" -d 'Changes the plant of a device in a running simulator, as its console does; exit 1 if the simulator refuses the change or cannot be reached'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "status" -d 'Prints the states of the devices in a running simulator; exit 1 if the device does not exist or the simulator cannot be reached'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "eds" -d 'Prints the EDS of a CANopen kind, generated from its object dictionary'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "dbc" -d 'Prints the DBC of an ISOBUS kind, with its messages at each address'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "completions" -d 'Prints the completion script for a shell'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "man" -d 'Prints the manual page, in roff'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and not __fish_seen_subcommand_from run use-case scenario campaign decode replay set status eds dbc completions man help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c pve-sim -n "__fish_pve_sim_using_subcommand help; and __fish_seen_subcommand_from campaign" -f -a "merge" -d 'Joins the results of shards, and reports them; exit 1 if a limit is broken or a row is missing'
