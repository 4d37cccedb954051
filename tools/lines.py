#!/usr/bin/env python3
"""Counts the lines of code of each module of src and cli/src: lines.py [CHECKOUT]

Blank lines, comments, files of tests, and `mod tests` at the end of a file do not count.
"""
import collections
import pathlib
import re
import sys

ENGINE = """accel control device exec frame graph layout passes plan projection quality samples schedule session stages
tables""".split()


def is_test(path: pathlib.Path) -> bool:
    return path.stem == "tests" or path.stem.endswith("_tests") or "tests" in path.parent.parts


def lines_of(path: pathlib.Path) -> int:
    count = 0
    for line in map(str.strip, path.read_text(encoding="utf-8").splitlines()):
        if re.match(r"(pub(\(\w+\))? )?mod tests \{", line):
            break
        count += line != "" and not line.startswith("//") and line != "#[cfg(test)]"
    return count


def main() -> None:
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    counts: collections.Counter[str] = collections.Counter()
    for folder in ("src", "cli/src"):
        for path in sorted((root / folder).rglob("*.rs")):
            of_source = path.relative_to(root / folder)
            module = of_source.parts[0].removesuffix(".rs")
            if folder == "cli/src" and module != "report":
                module = "cli"
            if not is_test(of_source):
                counts[module] += lines_of(path)
    for module, count in counts.most_common():
        print(f"{count:7,}  {module}")
    print(f"{sum(counts[module] for module in ENGINE):7,}  engine: {', '.join(m for m in ENGINE if counts[m])}")
    print(f"{counts.total():7,}  all")


if __name__ == "__main__":
    main()
