#!/bin/sh
# Runs `diptych view --xr` in a headset and checks its files. With Monado, this script starts its simulated headset and,
# with Python 3, one that remote-headset.py controls, with controllers. Without Monado it uses the headset of the
# runtime that XR_RUNTIME_JSON names, if there is one.
#
#   sh tools/test-xr.sh DIPTYCH OUT
#
# If OpenXR's and Vulkan's validation layers are installed, one run uses them. Without any runtime the script fails, or
# with NO_XR=skip only prints that.
set -eu

rm -rf "$2"
mkdir -p "$2"
diptych=$(realpath "$1")
out=$(realpath "$2")
service=""
job=""
folders=""
small="--size 32x36 --budget-ms 0.01..30000"

fail() {
    echo "test-xr: $*" >&2
    exit 1
}

manifest=""
for candidate in /usr/share /usr/local/share /etc/xdg; do
    [ ! -e "$candidate/openxr/1/openxr_monado.json" ] || manifest=$candidate/openxr/1/openxr_monado.json
done
if ! command -v monado-service >/dev/null || [ -z "$manifest" ]; then
    if [ -z "${XR_RUNTIME_JSON:-}" ]; then
        echo "################################################################################" >&2
        echo "# NOTHING WAS TESTED IN A HEADSET: there is no monado-service here, and        #" >&2
        echo "# XR_RUNTIME_JSON names no runtime (Debian 13: apt-get install monado-service  #" >&2
        echo "# libopenxr1-monado libopenxr-loader1)                                         #" >&2
        echo "################################################################################" >&2
        [ "${NO_XR:-}" = skip ] || exit 1
        exit 0
    fi
    manifest=""
fi

# Starts Monado's service with a null compositor and with this in its environment. It watches its standard input and
# ends if that is a file, so it gets a pipe that stays open.
begin_service() {
    [ -n "$manifest" ] || return 0
    XDG_RUNTIME_DIR=$(mktemp -d)
    folders="$folders $XDG_RUNTIME_DIR"
    chmod 700 "$XDG_RUNTIME_DIR"
    export XDG_RUNTIME_DIR XR_RUNTIME_JSON="$manifest"
    mkfifo "$XDG_RUNTIME_DIR/stdin"
    exec 3<>"$XDG_RUNTIME_DIR/stdin"
    env "$1" XRT_COMPOSITOR_NULL=1 monado-service <&3 >"$out/monado.log" 2>&1 &
    service=$!
    tries=0
    until [ -S "$XDG_RUNTIME_DIR/monado_comp_ipc" ]; do
        tries=$((tries + 1))
        [ "$tries" -lt 100 ] || fail "monado-service does not come up: $(tail -n 5 "$out/monado.log")"
        sleep 0.1
    done
}

end_service() {
    [ -n "$service" ] || return 0
    kill "$service" 2>/dev/null || true
    wait "$service" 2>/dev/null || true
    service=""
    exec 3>&-
}

end_all() {
    [ -z "$job" ] || kill "$job" 2>/dev/null || true
    end_service
    # Split folder names into words.
    # shellcheck disable=SC2086
    rm -rf $folders
}
trap end_all EXIT
trap 'exit 130' INT TERM

# Split $small into options.
# shellcheck disable=SC2086
view() {
    timeout 300 "$diptych" view "$@" --xr --quiet $small
}

has() {
    grep -q "$2" "$1" || fail "$1 has no $2: $(head -c 2000 "$1")"
}

begin_service SIMULATED_ENABLE=1
view builtin:checker --frames 300 --out "$out/frames" --record-motion "$out/motion.jsonl" --screenshot "$out/eyes.png" \
    --trace "$out/trace.json" || fail "300 frames ended with status $?"
count=$(grep -c '"motion_to_photon_ms":' "$out/frames/run.json")
[ "$count" = 300 ] || fail "run.json has $count frames of 300"
# States from the session's start to its end.
states=$(tr -d ' \n' <"$out/frames/run.json" | sed 's/.*"states":\[\([^]]*\)\].*/\1/')
case $states in
    *'"ready"'*'"synchronized"'*'"visible"'*'"stopping"'*'"exiting"') ;;
    *) fail "the session went through $states" ;;
esac
has "$out/trace.json" "motion to photon (ms)"
"$diptych" trace "$out/trace.json" >"$out/trace.txt" || fail "the trace is none"
[ "$(wc -l <"$out/motion.jsonl")" = 301 ] || fail "motion.jsonl has $(wc -l <"$out/motion.jsonl") lines"
has "$out/motion.jsonl" '"eyes"'
echo "session: 300 frames, ended by the session's end; $states"

# A recording must replay identically on any number of devices.
replay() {
    for devices in 1 2 3; do
        "$diptych" render builtin:checker --size 32x36 --set motion="$out/$1.jsonl" --frames 4 --fps 10 --quiet \
            --virtual "$devices" --threads-per-device 1 --out "$out/$1.$devices"
        for image in "$out/$1.1"/*.exr; do
            cmp "$image" "$out/$1.$devices/${image##*/}" || fail "$1: other bytes on $devices devices"
        done
    done
    echo "$1: replayed with the same bytes on 1, 2 and 3 devices"
}
replay motion

# Run with the layers that validate the use of OpenXR and Vulkan.
layers=0
for folder in /usr/share /usr/local/share /etc; do
    for layer in "$folder"/openxr/1/api_layers/explicit.d/*core_validation*.json; do
        [ ! -e "$layer" ] || { layers=$((layers + 1)) && export XR_ENABLE_API_LAYERS=XR_APILAYER_LUNARG_core_validation; }
    done
    for layer in "$folder"/vulkan/explicit_layer.d/*khronos_validation*.json; do
        [ ! -e "$layer" ] || { layers=$((layers + 1)) && export VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation; }
    done
done
if [ "$layers" -gt 0 ]; then
    export XR_CORE_VALIDATION_EXPORT_TYPE=text XR_CORE_VALIDATION_FILE_NAME="$out/openxr.log"
    view builtin:checker --frames 20 --panel >"$out/vulkan.log" 2>&1 || fail "under validation: $(tail -n 5 "$out/vulkan.log")"
    unset XR_ENABLE_API_LAYERS VK_INSTANCE_LAYERS XR_CORE_VALIDATION_EXPORT_TYPE XR_CORE_VALIDATION_FILE_NAME
    if grep -hE 'VALID_(ERROR|WARNING)' "$out/openxr.log" >"$out/said.log" 2>/dev/null ||
        grep -E 'Validation (Error|Warning)|VUID-|UNASSIGNED-' "$out/vulkan.log" >"$out/said.log"; then
        fail "validation: $(head -n 5 "$out/said.log")"
    fi
    echo "validation: $layers layer(s) found nothing wrong in 20 frames"
else
    echo "validation: SKIPPED, there is no layer for it (Debian: openxr-layer-corevalidation vulkan-validationlayers)"
fi

# Starts a run in the background, $job, and waits until it has shown some frames. Its files are $1.
left_running() {
    : >"$out/$1.log"
    # shellcheck disable=SC2086
    "$diptych" view builtin:checker --xr --json $small --out "$out/$1" --record-motion "$out/$1.jsonl" >"$out/$1.log" 2>&1 &
    job=$!
    tries=0
    until [ "$(grep -c '"event":"frame"' "$out/$1.log")" -gt 3 ]; do
        tries=$((tries + 1))
        [ "$tries" -lt 1200 ] || fail "$1: no frame within two minutes: $(tail -n 5 "$out/$1.log")"
        sleep 0.1
    done
}

# Terminates the run in the background.
end_job() {
    kill -TERM "$job"
    status=0
    wait "$job" || status=$?
    job=""
    [ "$status" = 143 ] || fail "$1: SIGTERM: status $status: $(tail -n 5 "$out/$1.log")"
}

# After SIGTERM, the run ends the session and writes all files.
left_running told
end_job told
has "$out/told/run.json" '"exiting"'
[ "$(wc -l <"$out/told.jsonl")" -gt 1 ] || fail "SIGTERM: no motion is recorded"
echo "sigterm: ended with status 143"

# Tests a runtime that disappears, and the absence of any runtime.
refused() {
    [ "$(grep -c '^error: ' "$1")" = 1 ] || fail "$1: not one line says what is wrong: $(cat "$1")"
    grep -q "^error: .*$2" "$1" || fail "$1: $(cat "$1")"
    echo "$3: $(grep '^error: ' "$1")"
}
if [ -n "$manifest" ]; then
    left_running left
    end_service
    status=0
    wait "$job" || status=$?
    job=""
    [ "$status" = 1 ] || fail "a runtime that goes away: status $status: $(tail -n 5 "$out/left.log")"
    refused "$out/left.log" "headset" "gone"
    [ "$(wc -l <"$out/left.jsonl")" -gt 1 ] || fail "a runtime that goes away: no motion is recorded"

    # Tests controllers, and asymmetric, canted eyes, with a headset that a program controls.
    if command -v python3 >/dev/null; then
        begin_service P_OVERRIDE_ACTIVE_CONFIG=remote
        mkfifo "$out/steps"
        python3 "$(dirname "$0")/remote-headset.py" <"$out/steps" >"$out/stepped" &
        exec 4>"$out/steps"
        left_running worn
        printf '%s\n' "ahead 1" "panel 0.5" "panel 0.5" "turn 0.5" "recentre 0.5" >&4
        tries=0
        until [ "$(wc -l <"$out/stepped")" = 5 ]; do
            tries=$((tries + 1))
            [ "$tries" -lt 300 ] || fail "the headset that a program wears is at step $(wc -l <"$out/stepped") of 5"
            sleep 0.1
        done
        end_job worn
        exec 4>&-
        end_service
        has "$out/worn/run.json" '"rectified": {'
        python3 - "$out/worn.jsonl" <<'CHECK' || fail "controllers: worn.jsonl is not where they went"
import json
import sys

header, *samples = map(json.loads, open(sys.argv[1]))
left = header["eyes"]["left"]
assert abs(left["fov"]["left"] + 0.9) < 1e-3 and abs(left["fov"]["right"] - 0.7) < 1e-3, left
assert abs(left["orientation"][1] - 0.045) < 1e-3, left
x, y, z = zip(*(sample["position_m"] for sample in samples))
turned = [abs(sample["orientation"][1]) > 0.5 for sample in samples]
assert z[0] == 0.0 and max(map(abs, x + y)) < 1e-3, "level and straight ahead"
furthest = min(z)
assert furthest < -1.0 and turned[0] is False, "ahead"
assert any(is_turned and at == furthest for is_turned, at in zip(turned, z)), "it stays where it turns"
assert abs(z[-1]) < 1e-3 and not turned[-1], "back at first, looking ahead"
CHECK
        echo "controllers: went ahead, showed and hid the panel, turned, and went back to where it was"
        replay worn
    else
        echo "controllers: SKIPPED, there is no python3 to wear a headset of Monado's remote driver"
    fi
    XDG_RUNTIME_DIR=$(mktemp -d)
    folders="$folders $XDG_RUNTIME_DIR"
fi
status=0
XR_RUNTIME_JSON=/nowhere.json "$diptych" view builtin:checker --xr --quiet $small >"$out/none.log" 2>&1 || status=$?
[ "$status" = 1 ] || fail "without a runtime: status $status"
refused "$out/none.log" "no OpenXR runtime answers" "none"
echo "all that was run in a headset is as it should be"
