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


def rows_text(columns, rows):
    text = line([c["title"] for c in columns]) + line(["---"] * len(columns))
    return text + "".join(line([cell(c, row) for c in columns]) for row in rows)


def table_text(table):
    """All rows and, below, their caption."""
    measured = table["measured"]
    caption = f"{table['note']} {measured['machine']}; {'; '.join(measured['drivers'])}."
    caption += f" Commit {measured['commit']}, {measured['date']}"
    if measured["others"] is not None:
        caption += f"; other programs took {measured['others'] * 100:.1f} % of the cores"
    absent = "".join(f" Not measured: {what}." for what in table["absent"])
    return f"{rows_text(table['columns'], table['rows'])}\n*{caption}.{absent}*\n"


def short_text(table):
    """The rows and columns of README.md, with a link to all others."""
    readme, measured = table["readme"], table["measured"]
    columns = [c for c in table["columns"] if c["key"] in readme["columns"]]
    rows = [row for row in table["rows"] if all(row[key] in values for key, values in readme["rows"].items())]
    anchor = re.sub(r"[^\w -]", "", table["title"].lower()).replace(" ", "-")
    where = f"[All rows](docs/results/results.md#{anchor}): commit {measured['commit']}, {measured['machine']}."
    return f"{rows_text(columns, rows)}\n*{readme['note']} {where}*\n"


def page(results):
    """docs/results/results.md."""
    text = "# Results\n\n`make numbers` measures these tables; those of Mitsuba need `WITH_PEERS=1`, rows of a second driver "
    text += "`NEWER_MESA=COMMAND`. It writes this file, [its data](results.json) and the tables of "
    text += "[README.md](../../README.md).\n"
    for table in results["tables"].values():
        text += f"\n## {table['title']}\n\n{table_text(table)}"
    return text if results["tables"] else text + "\nNo table has been measured yet.\n"


def with_table(readme, name, table):
    """README.md's text with the table in its block."""
    begin, end = f"<!-- results: {name} -->\n", "<!-- /results -->\n"
    if begin not in readme:
        sys.exit(f"README.md lacks {begin.strip()}")
    before, rest = readme.split(begin, 1)
    return before + begin + short_text(table) + end + rest.split(end, 1)[1]


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
