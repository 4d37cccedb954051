"""Writes the licences of the crates that a program contains, for archives of releases.

    python3 tools/licences.py --target x86_64-unknown-linux-gnu --features view,xr > THIRD-PARTY.txt

Crates that share a text are listed together before it. A crate without a licence file is listed with its SPDX
expression and its authors. Needs nothing but Python and Cargo.
"""

import argparse
import json
import os
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

# Sources within crates whose last comment is the licence of a library that the crate contains.
VENDORED = {"meshopt": "vendor/src/meshoptimizer.h"}
REMARKS = """\
diptych contains the crates below, under these licences, and the standard library of Rust, by The Rust Project
Contributors: MIT OR Apache-2.0 (https://github.com/rust-lang/rust). The crate noto-sans-mono-bitmap contains glyphs of
the font Noto Sans Mono, by The Noto Project Authors: OFL-1.1 (https://openfontlicense.org)."""
NAMES = re.compile(r"(licen[cs]e|copying|notice|copyright|unlicense|ofl|ufl)", re.IGNORECASE)


def metadata(target, features):
    cargo = os.environ.get("CARGO", "cargo")
    command = [cargo, "metadata", "--locked", "--format-version", "1", "--filter-platform", target]
    command += ["--manifest-path", "cli/Cargo.toml"]
    command += ["--features", features] if features else []
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def linked(graph):
    """Returns the ids of all crates that the root depends on, without those of builds and tests alone."""
    nodes = {node["id"]: node for node in graph["nodes"]}
    found, left = set(), [graph["root"]]
    while left:
        node = left.pop()
        if node not in found:
            found.add(node)
            normal = (d for d in nodes[node]["deps"] if any(kind["kind"] is None for kind in d["dep_kinds"]))
            left += [dependency["pkg"] for dependency in normal]
    return found - {graph["root"]}


def texts_of(package):
    """Returns the licence texts in the folder of a crate and in its folders of licences and fonts."""
    folder = Path(package["manifest_path"]).parent
    files = [file for file in folder.rglob("*") if file.is_file() and NAMES.match(file.name)]
    if package["license_file"]:
        files.append(folder / package["license_file"])
    code = {".rs", ".py", ".c", ".h", ".cpp", ".toml", ".json"}
    files = sorted({file.resolve() for file in files if file.suffix.lower() not in code})
    texts = [file.read_text(encoding="utf-8", errors="replace").strip() for file in files]
    if package["name"] in VENDORED:
        source = (folder / VENDORED[package["name"]]).read_text(encoding="utf-8")
        texts.append(re.sub(r"^ \* ?", "", source[source.rindex("/**\n") + 4 : source.rindex(" */")], flags=re.MULTILINE))
    return [text for text in texts if text]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--target", required=True)
    parser.add_argument("--features", default="")
    options = parser.parse_args()
    sys.stdout.reconfigure(encoding="utf-8", newline="\n")
    of = metadata(options.target, options.features)
    ids = linked(of["resolve"])
    crates, spelling, bare = defaultdict(set), {}, []
    for package in of["packages"]:
        if package["id"] in ids and package["source"]:
            name = f"{package['name']} {package['version']}"
            texts = texts_of(package)
            for text in texts:
                # Crates wrap the same licence in different ways.
                key = " ".join(text.split())
                spelling.setdefault(key, text)
                crates[key].add(name)
            if not texts:
                authors = f" ({', '.join(package['authors'])})" if package["authors"] else ""
                bare.append(f"{name}: {package['license']}{authors}")
    print(REMARKS)
    if bare:
        print("\nCrates that contain no licence text, with the names of their licences and authors:\n")
        print("\n".join(sorted(bare)))
    for key in sorted(crates, key=lambda key: sorted(crates[key])):
        print(f"\n{'=' * 80}\n{', '.join(sorted(crates[key]))}\n{'=' * 80}\n\n{spelling[key]}")


if __name__ == "__main__":
    main()
