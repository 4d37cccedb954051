#!/bin/sh
# Builds the documentation site in the folder $1: the documents of the repository as a book, by mdBook, with the reference
# of the library in its folder `api`. Chapters are the rows of docs/README.md and the decisions.
set -eu

cd "$(dirname "$0")/.."
out=${1:-out/docs}
command -v mdbook >/dev/null 2>&1 || {
    echo "docs: mdbook is missing: cargo install mdbook --locked" >&2
    exit 1
}

source=$(mktemp -d)
trap 'rm -rf "$source"' EXIT
mkdir "$source/src"
# All tracked files, so that links to sources lead somewhere.
git ls-files -z | xargs -0 cp --parents -t "$source/src"
cat >"$source/book.toml" <<'END'
[book]
title = "diptych"
language = "en"
[output.html]
no-section-label = true
END
title() {
    sed -n 's/^# //p;/^# /q' "$1"
}
{
    echo '# Summary'
    echo '[diptych](README.md)'
    sed -n 's/^| \[\([^]]*\)\](\([a-z/-]*\.md\)) .*/- [\1](docs\/\2)/p' docs/README.md
    echo '- [Decisions](docs/README.md)'
    for page in docs/decisions/*.md docs/results/peers/*.md; do
        echo "    - [$(title "$page")]($page)"
    done
    echo '- [Architecture](ARCHITECTURE.md)'
    echo '    - [Execution](src/exec/README.md)'
    echo '- [Contributing](CONTRIBUTING.md)'
    echo '- [Changes](CHANGELOG.md)'
} >"$source/src/SUMMARY.md"
mkdir -p "$out"
out=$(cd "$out" && pwd)
mdbook build "$source" --dest-dir "$out"
RUSTDOCFLAGS="-D warnings" ${CARGO:-cargo} doc --no-deps --locked --features view,xr
rm -rf "$out/api"
cp -r "${CARGO_TARGET_DIR:-target}/doc" "$out/api"
echo "docs: $out/index.html, and $out/api/diptych/index.html"
