#!/bin/sh
# Runs all checks before a release, and writes docs/results/release-check.md: each step's result, duration and tests.
#
#   sh tools/release-check.sh [STEP...]        (make release-check STEPS="lint test")
#
# Steps whose names end in -newer run under a second driver: NEWER_MESA is a command that runs another one under it. By
# default all steps run. A step that lacks a tool is skipped; xr also finds Monado in the second driver's system. A
# failed step does not stop the others, but the status is then 1. Results of other steps stay in the report, each with
# its commit, so that steps can run separately. GOLDEN is an optional folder with golden.txt and golden-newer.txt of an
# earlier build: images must have these hashes.
set -eu

cd "$(dirname "$0")/.."
all="lint test hardware-rays mpi xr view python golden test-newer golden-newer golden-compare test-full test-full-newer"
state=out/release-check
report=docs/results/release-check.md
make=${MAKE:-make}
steps=${*:-$all}
# Commands may use a variable of that name.
newer=${NEWER_MESA:-}
unset NEWER_MESA

fail() {
    echo "release-check: $*" >&2
    exit 2
}

for step in $steps; do
    case " $all " in
    *" $step "*) ;;
    *) fail "there is no step $step, but $all" ;;
    esac
done
commit=$(git rev-parse HEAD)
short=$(printf %.7s "$commit")
[ -z "$(git status --porcelain -- . ":!$report")" ] || fail "commit your changes first: results are those of a commit"
[ "$(cat $state/commit 2>/dev/null)" = "$commit" ] || rm -rf $state
mkdir -p $state
echo "$commit" >$state/commit

has() {
    command -v "$1" >/dev/null 2>&1
}

# Ends a step that cannot run here.
skip() {
    echo "$*"
    exit 77
}

program() {
    for profile in release tests; do
        built=${CARGO_TARGET_DIR:-target}/$profile/diptych
        [ ! -x "$built" ] || { echo "$built" && return; }
    done
}

# Lists values of the field $2 for the program's devices, run under the command $1 (or directly, if that is empty).
devices() {
    # The command may have arguments.
    # shellcheck disable=SC2086
    $1 "$(program)" info --json 2>/dev/null | sed -n "s/.*\"$2\": \"\{0,1\}\([^\"]*[^\",]\)\"\{0,1\},*\$/\1/p" | sort -u
}

hardware_rays() {
    ${CARGO:-cargo} build --release --locked || exit 1
    for run in "" "$newer"; do
        if devices "$run" ray_queries | grep -q true; then
            $make test-hardware-rays RUN="$run"
            exit
        fi
    done
    skip "no driver here has ray queries"
}

golden() {
    before=${GOLDEN:+$GOLDEN/$1.txt}
    [ -e "$before" ] || before=
    $make golden RUN="$2" BEFORE="$before" || exit 1
    cp out/golden.txt "$state/$1.txt"
    [ -n "$before" ] || echo "$(wc -l <out/golden.txt) images, and no earlier build to compare with"
}

golden_compare() {
    for table in golden golden-newer; do
        [ -e $state/$table.txt ] || skip "there are no images of both drivers"
        sort -k 2 $state/$table.txt >$state/$table.sorted
        cut -d ' ' -f 2- $state/$table.sorted >$state/$table.names
    done
    cmp $state/golden.names $state/golden-newer.names || exit 1
    same=$(comm -12 $state/golden.sorted $state/golden-newer.sorted | wc -l)
    echo "$same of $(wc -l <$state/golden.names) images have the same bytes under both drivers"
}

run_step() {
    run=
    case $1 in
    *-newer)
        run=$newer
        [ -n "$run" ] || skip "NEWER_MESA names no command"
        # Doc tests put their programs into the temporary folder, and the command's system may have another one.
        mkdir -p $state/tmp
        export TMPDIR="$PWD/$state/tmp"
        ;;
    mpi) sh tools/deps-mpi.sh || skip "there is no MPI, and none could be installed" ;;
    xr)
        if [ -n "$newer" ] && ! has monado-service && $newer sh -c 'command -v monado-service' >/dev/null; then
            run=$newer
        fi
        has monado-service || [ -n "$run${XR_RUNTIME_JSON:-}" ] || skip "there is no OpenXR runtime"
        ;;
    view) { has Xvfb && has xdotool; } || skip "there is no Xvfb or no xdotool" ;;
    python) has python3 || skip "there is no Python 3" ;;
    esac
    case $1 in
    hardware-rays) hardware_rays ;;
    golden | golden-newer) golden "$1" "$run" ;;
    golden-compare) golden_compare ;;
    mpi | view) $make "test-$1" ;;
    xr) $make test-xr RUN="$run" ;;
    *) $make "${1%-newer}" RUN="$run" ;;
    esac
}

# Numbers of tests in the log $1, as columns of the report.
tests() {
    awk '/^test result: / { n++; gsub(/;/, ""); for (i = 1; i < NF; i++) { if ($(i + 1) ~ /^(passed|failed|ignored)$/) sum[$(i + 1)] += $i } }
        END { if (n) printf "%d | %d | %d", sum["passed"], sum["failed"], sum["ignored"]; else printf "– | – | –" }' "$1"
}

for step in $steps; do
    log=$state/$step.log
    echo "release-check: $step, into $log"
    begin=$(date +%s)
    status=0
    (run_step "$step") >"$log" 2>&1 || status=$?
    took=$(($(date +%s) - begin))
    remark=
    case $status in
    0)
        result=passed
        case $step in golden*) remark=$(grep -v '^make' "$log" | tail -n 1) ;; esac
        ;;
    77) result=skipped remark=$(tail -n 1 "$log") ;;
    *) result=**failed** remark=$(sed -n 's/^test \(.*\) \.\.\. FAILED$/`\1`/p' "$log" | sort -u | head -n 5 | paste -s -d ' ' -) ;;
    esac
    duration=$(printf '%d:%02d:%02d' $((took / 3600)) $((took / 60 % 60)) $((took % 60)))
    echo "| $step | $result | $short | $(date -u '+%F %R') | $duration | $(tests "$log") | $remark |" >"$state/$step.row"
    echo "release-check: $step: $result $remark"
done

# Names of the driver $1, under which the command $2 runs the program. They are saved for runs without that command, and
# for programs with features that the command's system cannot run.
driver() {
    found=$([ -z "$(program)" ] || devices "$2" driver | paste -s -d , -)
    [ -z "$found" ] || echo "$found" >"$state/$1"
    cat "$state/$1" 2>/dev/null || echo unknown
}

{
    echo "# Release check"
    echo
    echo "\`make release-check\` writes this file. The table lists the commit of each step's last run. The columns passed,"
    echo "failed and ignored count tests; durations are in hours, minutes and seconds."
    echo
    echo "| | |"
    echo "| --- | --- |"
    echo "| commit | $commit |"
    echo "| date | $(date -u '+%F %R') UTC |"
    echo "| diptych | $(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1) |"
    echo "| compiler | $(${RUSTC:-rustc} --version) |"
    echo "| driver | $(driver driver "") |"
    [ -z "$newer" ] && [ ! -e $state/driver-newer ] || echo "| driver of \`-newer\` | $(driver driver-newer "${newer:-false}") |"
    echo
    echo "| step | result | commit | ended (UTC) | duration | passed | failed | ignored | remarks |"
    echo "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    for step in $all; do
        # Includes results of earlier commits.
        cat "$state/$step.row" 2>/dev/null || grep "^| $step |" $report 2>/dev/null ||
            echo "| $step | not run | – | – | – | – | – | – | |"
    done
} >"$state/report"
cp $state/report $report
failed=$(grep -l '| \*\*failed\*\* |' $state/*.row | wc -l)
echo "release-check: $report says how it went"
[ "$failed" -eq 0 ] || { echo "release-check: $failed steps failed" >&2; exit 1; }
