"""Writes tables of measurements as Markdown. tests/models/results.rs runs this."""

import json
import re
import sys


def cell(column, row):
    value = row.get(column["key"])
    if value is None:
        return "–"
    if "decimals" not in column:
        return str(value)
    return f"{value * 100:.{column['decimals']}f} %" if column["percent"] else f"{value:.{column['decimals']}f}"


def line(cells):
    return "| " + " | ".join(cells) + " |\n"


def table_text(table, rows=None):
    """The rows, or only those whose values are among `rows`, and, below, their caption."""
    columns, measured = table["columns"], table["measured"]
    shown = [row for row in table["rows"] if all(row[key] in values for key, values in (rows or {}).items())]
    text = line([c["title"] for c in columns]) + line(["---"] * len(columns))
    text += "".join(line([cell(c, row) for c in columns]) for row in shown)
    caption = f"{table['note']} {measured['machine']}; {'; '.join(measured['drivers'])}."
    caption += f" Commit {measured['commit']}, {measured['date']}"
    if measured["others"] is not None:
        caption += f"; other programs took {measured['others'] * 100:.1f} % of the cores"
    absent = "".join(f" Not measured: {what}." for what in table["absent"])
    return f"{text}\n*{caption}.{absent}*\n"


def page(results):
    """docs/results/results.md."""
    text = "# Results\n\n`make numbers` measures these tables; those of Mitsuba need `WITH_PEERS=1`, rows of a second driver "
    text += "`NEWER_MESA=COMMAND`. It writes this file, [its data](results.json) and the tables of "
    text += "[README.md](../../README.md).\n"
    for table in results["tables"].values():
        text += f"\n## {table['title']}\n\n{table_text(table)}"
    return text if results["tables"] else text + "\nNo table has been measured yet.\n"


def with_table(readme, name, table):
    """README.md's text with the table in its block or, before it has one, in place of the first table of its section."""
    begin, end = f"<!-- results: {name} -->\n", "<!-- /results -->\n"
    block = begin + table_text(table, table.get("readme_rows")) + end
    if begin in readme:
        before, rest = readme.split(begin, 1)
        return before + block + rest.split(end, 1)[1]
    section = re.search(rf"^{re.escape(table['readme'])}\n.*?(?=^##|\Z)", readme, re.M | re.S)
    if not section:
        sys.exit(f"README.md has neither {begin.strip()} nor the heading {table['readme']}")
    # A table that begins a paragraph, with its caption. Tables of blocks follow a comment instead.
    changed, found = re.subn(r"(?<=\n\n)(\|.*\n)+(\n\*.*\*\n)?", lambda _: block, section[0], count=1)
    if not found:
        changed = f"{section[0].rstrip()}\n\n{block}\n"
    return readme[: section.start()] + changed + readme[section.end() :]


def json_text(results):
    """Results as JSON, in which each row of a table is a line."""
    text = json.dumps(results, indent=1, ensure_ascii=False)
    # Only elements of lists begin a line with a brace. Strings have no line breaks.
    return re.sub(r"\n +\{[^{}]*\}", lambda row: re.sub(r"(?<=.)\n +", " ", row[0], flags=re.S), text) + "\n"


def write(root, results):
    """All files that follow from the results. README.md is last, since a place may be missing there."""
    (root / "docs/results/results.json").write_text(json_text(results))
    (root / "docs/results/results.md").write_text(page(results))
    readme = (root / "README.md").read_text()
    for name, table in results["tables"].items():
        if table["readme"]:
            readme = with_table(readme, name, table)
    (root / "README.md").write_text(readme)
