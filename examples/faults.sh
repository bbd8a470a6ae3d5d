#!/bin/sh
# Breaks two valves in every way there is and waits for each outcome, with curl alone: a pattern for a test in CI. Time is
# stepped, so nothing sleeps, and each run is the same.
#
#   pve-sim --speed step --device pvea-canopen@0x20,name=boom --device pvea-isobus@0x80,name=arm
#   examples/faults.sh http://127.0.0.1:8408
set -eu

api="${1:-http://127.0.0.1:8408}/api/v1"

# call METHOD PATH [JSON]: prints the answer, and ends the script when the call is refused.
call() {
    if [ $# -gt 2 ]; then set -- "$1" "$2" --data "$3"; fi
    method=$1 path=$2
    shift 2
    answer=$(curl --silent --show-error --fail-with-body --request "$method" --header 'Content-Type: application/json' \
        "$@" "$api$path") || { echo "$method $path $*: $answer" >&2; exit 1; }
    echo "$answer"
}

plant() { call PATCH "/devices/$1/plant" "$2" >/dev/null; }
power() { call POST "/devices/$1/power" "$2" >/dev/null; }
frame() { call POST /bus/frames "$1" >/dev/null; }
wait_for() { call POST /wait "{\"device\": \"$1\", \"state\": $2, \"within_ms\": 5000}" >/dev/null; }

# set_point NAME half|back|float: a master that sends it every 100 ms.
set_point() {
    call DELETE /bus/frames >/dev/null
    case $1-$2 in
    boom-half) data=0F000020 ;;
    boom-back) data=0F0000C0 ;;
    boom-float) data=0F00FF7F ;;
    arm-half) data=7DFF31FFFFFFFFFF ;;
    arm-back) data=FAFF32FFFFFFFFFF ;;
    arm-float) data=00FF33FFFFFFFFFF ;;
    esac
    case $1 in
    boom) frame "{\"id\": 544, \"data\": \"$data\", \"every_ms\": 100}" ;;
    arm) frame "{\"id\": 217985063, \"extended\": true, \"data\": \"$data\", \"every_ms\": 100}" ;;
    esac
}

# at_work NAME: a healthy valve that has followed its master to half the stroke.
at_work() {
    call DELETE /bus/frames >/dev/null
    power "$1" '{"on": false}'
    plant "$1" '{"supply_mv": 24000, "temperature_c": 25, "spool": {"fault": null}, "internal_fault": false,
                 "memory": "ok", "bus_off": false}'
    power "$1" '{"on": true}'
    wait_for "$1" '{"powered": true}'
    call POST /time '{"advance_ms": 50}' >/dev/null
    if [ "$1" = boom ]; then frame '{"id": 0, "data": "0120"}'; fi
    set_point "$1" half
    wait_for "$1" '{"position": 8192, "solenoids": true, "faults": []}'
}

# shuts_down NAME FAULT: the fault comes, alone, and the valve lets go.
shuts_down() {
    wait_for "$1" "{\"faults\": [\"$2\"], \"led\": {\"color\": \"red\"}, \"solenoids\": false}"
    echo "$1: $2"
}

for valve in boom arm; do
    for fault in supply-low:'{"supply_mv": 8000}' supply-high:'{"supply_mv": 40000}' temperature:'{"temperature_c": 130}' \
        internal:'{"internal_fault": true}' can-bus:'{"bus_off": true}'; do
        at_work $valve
        plant $valve "${fault#*:}"
        shuts_down $valve "${fault%%:*}"
    done

    at_work $valve
    plant $valve '{"spool": {"fault": "stuck"}}'
    set_point $valve back
    shuts_down $valve spool-not-at-set-point

    at_work $valve
    plant $valve '{"spool": {"fault": "no-float"}}'
    set_point $valve float
    shuts_down $valve float-not-reached

    at_work $valve
    call DELETE /bus/frames >/dev/null
    shuts_down $valve time-guarding

    at_work $valve
    call DELETE /bus/frames >/dev/null
    plant $valve '{"memory": "damaged"}'
    power $valve '{"reset": "watchdog"}'
    shuts_down $valve internal
done
