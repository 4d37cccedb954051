#!/bin/sh
# Runs diptych on 1, 2 and 4 ranks of this machine, and compares the files with those of one process. Then tests ranks
# that do not match, a lost device, and ranks that are terminated or killed.
#
#   sh tools/test-mpi.sh DIPTYCH MPIRUN OUT
#
# SOAK=N also renders N small frames on 4 ranks.
set -eu

mpirun=$2
rm -rf "$3"
mkdir -p "$3"
diptych=$(realpath "$1")
out=$(realpath "$3")

# OpenMPI needs these to run as root, like in containers, and with more processes than cores.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1
export OMPI_MCA_hwloc_base_binding_policy=none
small="--size 64x72 --quiet --threads-per-device 1"

fail() {
    echo "test-mpi: $*" >&2
    exit 1
}

# Runs the options that follow on $1 ranks with $2 devices each.
on() {
    ranks=$1
    each=$2
    shift 2
    # Split $small into options.
    # shellcheck disable=SC2086
    timeout 300 "$mpirun" -n "$ranks" "$diptych" "$@" $small --virtual "$each"
}

same_files() {
    for file in "$1"/*.exr "$1"/*.png; do
        cmp "$file" "$2/${file##*/}" || fail "$3"
    done
}

case_of() {
    name=$1
    shift
    # shellcheck disable=SC2086
    "$diptych" render "$@" $small --virtual 4 --out "$out/$name"
    for arrangement in "1 4" "2 2" "4 1"; do
        ranks=${arrangement% *}
        each=${arrangement#* }
        on "$ranks" "$each" render "$@" --out "$out/$name.$ranks" || fail "$name on $ranks ranks ended with status $?"
        same_files "$out/$name" "$out/$name.$ranks" "$name on $ranks x $each devices has other bytes than one process"
    done
    echo "$name: same bytes on 1 x 4, 2 x 2 and 4 x 1 devices"
}

case_of history builtin:checker --frames 4
case_of ragged builtin:checker --frames 4 --ratios 5,1,2,1 --set frames_in_flight=3
case_of layers builtin:checker --frames 3 --foveation layers
case_of visual-polar builtin:checker --frames 3 --foveation visual-polar
case_of log-polar builtin:checker --frames 3 --foveation log-polar
case_of moving builtin:studio --frames 3 --fps 10 --set frames_in_flight=2
case_of views builtin:checker --frames 3 --views 3 --baseline 0.02

# Each run below must print one line that names the error, and leave no process behind.
refused() {
    name=$1
    expected=$2
    shift 2
    status=0
    timeout 60 "$@" >"$out/$name.log" 2>&1 || status=$?
    [ "$status" -ne 0 ] && [ "$status" -ne 124 ] || fail "$name ended with status $status"
    lines=$(grep -c '^error: ' "$out/$name.log" || true)
    [ "$lines" = 1 ] || fail "$name: $lines lines say what is wrong: $(cat "$out/$name.log")"
    grep -q "^error: .*$expected" "$out/$name.log" || fail "$name: $(cat "$out/$name.log")"
    echo "$name: $(grep '^error: ' "$out/$name.log")"
}

# shellcheck disable=SC2086
{
    refused options "unexpected argument" "$mpirun" -n 2 "$diptych" render --nonsense
    refused no-file "nowhere.toml" "$mpirun" -n 2 "$diptych" render "$out/nowhere.toml" --out "$out/refused"
    good="$diptych render builtin:checker $small --out $out/refused"
    refused no-adapter "rank 1 on .*adapter 99" "$mpirun" -n 1 $good : -n 1 $good --devices 99
    refused other-command "rank 1 on" "$mpirun" -n 1 $good : -n 1 "$diptych" devices
    for scene in cornell checker; do
        "$diptych" export "builtin:$scene" --out "$out/$scene" >/dev/null
        mv "$out/$scene/$scene.glb" "$out/$scene/scene.glb"
    done
    shot="$diptych render scene.glb $small --out $out/refused"
    refused other-scene "rank 1 on .*scene is not that of rank 0" "$mpirun" -n 1 -wdir "$out/cornell" $shot : \
        -n 1 -wdir "$out/checker" $shot
    # Rank 0's files take precedence over the rank's own, which need not exist.
    mkdir "$out/empty"
    (cd "$out/cornell" && "$diptych" render scene.glb $small --out "$out/alone")
    for folder in checker empty; do
        timeout 60 "$mpirun" -n 1 -wdir "$out/cornell" $shot --broadcast-scene : \
            -n 1 -wdir "$out/$folder" $shot --broadcast-scene || fail "a scene that is sent to a rank in $folder"
        same_files "$out/alone" "$out/refused" "a scene that is sent has other bytes"
    done
    echo "broadcast: same bytes with the scene that rank 0 sends"
}

on 2 2 render builtin:checker --frames 4 --disturb loss:dev3@frame2 --denoiser atrous --out "$out/loss" 2>"$out/loss.log"
on 1 1 render builtin:checker --frames 4 --denoiser atrous --out "$out/whole"
same_files "$out/whole" "$out/loss" "a device that rank 1 loses changes bytes"
grep -q "device 3" "$out/loss.log" || fail "nothing says that device 3 is lost"
echo "loss: a device of rank 1 is lost, same bytes"

on 4 1 render builtin:checker --frames 4 --trace "$out/trace.json" --out "$out/traced"
for rank in 1 2 3; do
    grep -q "\"host of rank $rank on " "$out/trace.json" || fail "the trace has no threads of rank $rank"
done
"$diptych" trace "$out/trace.json" >"$out/trace.log" || fail "the trace of 4 ranks is not one"
said=$(grep "^MPI threads caused at most" "$out/trace.log") || fail "nothing says what MPI threads caused"
echo "trace: threads of all ranks; $said"

# Process of rank $1 of the current job. Ranks are started in order.
rank_of() {
    pgrep -f "^$diptych render .*$out/ended" | sort -n | sed -n "$(($1 + 1))p"
}

# Sends signal $2 to rank $3 of a running job. It must end within $4 seconds with status $5, or with any except 0.
ended() {
    name=$1
    rm -rf "$out/ended"
    # shellcheck disable=SC2086
    "$mpirun" -n 2 "$diptych" render builtin:checker $small --frames 100000 --out "$out/ended" >"$out/$name.log" 2>&1 &
    job=$!
    tries=0
    until [ -e "$out/ended/stereo.0002.png" ]; do
        tries=$((tries + 1))
        [ "$tries" -lt 600 ] || fail "$name: no frame within a minute"
        sleep 0.1
    done
    kill "-$2" "$(rank_of "$3")"
    begin=$(date +%s)
    status=0
    wait "$job" || status=$?
    took=$(($(date +%s) - begin))
    [ "$took" -le "$4" ] || fail "$name: it took $took s to end"
    [ "$status" -ne 0 ] || fail "$name: it ended with status 0"
    [ -z "$5" ] || [ "$status" = "$5" ] || fail "$name: it ended with status $status, not $5"
    [ -z "$(rank_of 0)" ] || fail "$name: a rank stays behind"
    if [ -n "$5" ]; then
        [ -e "$out/ended/run.json" ] || fail "$name: there is no run.json"
    fi
    # MPICH's mpirun names only the machine of a killed process.
    grep -q "rank $6\|RUNNING AT" "$out/$name.log" || [ -z "$6" ] || fail "$name: rank $6 is not named: $(cat "$out/$name.log")"
    for image in "$out"/ended/left.*.exr; do
        "$diptych" compare "$image" "$image" >/dev/null || fail "$name: $image is not whole"
        [ "${image##*.0000}" = "$image" ] || break
    done
    echo "$name: ended after $took s with status $status"
}

ended sigterm-rank-0 TERM 0 10 143 ""
ended sigterm-rank-1 TERM 1 10 143 ""
ended sigint-rank-0 INT 0 10 130 ""
ended stopped-rank-1 STOP 1 10 "" 1
ended killed-rank-1 KILL 1 10 "" 1
ended killed-rank-0 KILL 0 10 "" 0

# Renders many small frames with one setting, with history from the first to the last, and samples memory every few
# seconds.
if [ -n "${SOAK:-}" ]; then
    cat >"$out/soak.toml" <<'RUNG'
[origin]
shot = "builtin:checker"
size = "32x18"
exposure_ev = 0.0
measure = "estimate"
devices = []
version = "0.1.0"

[[rung]]
estimated = true
estimated_ms = 1.0
estimated_error = 0.1

[rung.knobs]
spp = 1
bounces = 3
denoiser = "svgf"
iterations = 2
scale = 1.0
RUNG
    small="--size 32x18 --quiet --threads-per-device 1"
    set -- play builtin:checker --frames "$SOAK" --ladder "$out/soak.toml" --budget-ms 1..1000 --fps 1000
    # shellcheck disable=SC2086
    timeout 14400 "$mpirun" -n 4 "$diptych" "$@" $small --out "$out/soak" &
    soak=$!
    : >"$out/soak.kib"
    while kill -0 "$soak" 2>/dev/null; do
        pids=$(pgrep -f "^$diptych play .*--out $out/soak\$" | tr '\n' ',')
        # Sample from the time that all ranks have begun until the first one ends.
        [ "$(echo "$pids" | tr -cd , | wc -c)" -lt 4 ] || ps -o rss= -p "${pids%,}" | awk '{ s += $1 } END { print s }' >>"$out/soak.kib"
        sleep 5
    done
    wait "$soak" || fail "the soak ended with status $?"
    # Compare the last tenth with the second, in which caches are warm.
    awk '{ kib[NR] = $1 } END {
        tenth = int(NR / 10); if (tenth < 1) { print "soak: too short to look at memory"; exit }
        for (i = 1; i <= tenth; i++) { first += kib[tenth + i]; last += kib[NR - i] }
        printf "soak: %d MiB on all ranks in the second tenth of its time, %d MiB in the last\n", first / tenth / 1024, last / tenth / 1024
        exit (last > 1.05 * first)
    }' "$out/soak.kib" || fail "memory has grown: $out/soak.kib"
    # shellcheck disable=SC2086
    "$diptych" "$@" $small --out "$out/soak.1"
    same_files "$out/soak.1" "$out/soak" "the last frame of the soak has other bytes than on one rank"
    echo "soak: $SOAK frames on 4 ranks, and the last has the bytes of one"
fi
echo "all that was run on ranks is as it should be"
