#!/bin/sh
# Packs the program $1, built for the target $2 with the Cargo features $3, into the folder $4: an archive with
# licences, manual pages and shell completions. The program writes the last two, so it must run on this machine.
set -eu

program=$1 target=$2 features=$3 out=$4
version=$("$program" --version | tr -d '\r' | cut -d ' ' -f 2)
name=diptych-$version-$target
python=python3
"$python" -c "" 2>/dev/null || python=python

rm -rf "${out:?}/$name"
mkdir -p "$out/$name/completions"
cp "$program" README.md CHANGELOG.md CITATION.cff LICENSE-APACHE LICENSE-MIT "$out/$name"
cp scenes/LICENSES.md "$out/$name/SCENES-LICENSES.md"
"$python" tools/licences.py --target "$target" --features "$features" >"$out/$name/THIRD-PARTY.txt"
"$program" generate man --out "$out/$name/man" >/dev/null
"$program" generate bash >"$out/$name/completions/diptych.bash"
"$program" generate zsh >"$out/$name/completions/_diptych"
"$program" generate fish >"$out/$name/completions/diptych.fish"
"$program" generate powershell >"$out/$name/completions/_diptych.ps1"

cd "$out"
case $target in
*windows*)
    rm -f "$name.zip"
    7z a -bso0 "$name.zip" "$name"
    echo "$out/$name.zip"
    ;;
*)
    tar -czf "$name.tar.gz" "$name"
    echo "$out/$name.tar.gz"
    ;;
esac
rm -rf "$name"
