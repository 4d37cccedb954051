//! Results as one page of HTML that stands alone: charts are in it, nothing is fetched and nothing runs.

use super::Table;

/// A part of a page: what is said first, then the table, then the figure.
#[derive(Clone, Debug, Default)]
pub struct Section {
    pub heading: &'static str,
    /// Paragraphs.
    pub notes: Vec<String>,
    pub table: Option<Table>,
    /// SVG, taken as it is.
    pub figure: Option<String>,
}

const STYLE: &str = "\
body { margin: 2rem auto; max-width: 64rem; padding: 0 1rem; font: 16px/1.5 sans-serif; color: #282828; background: #fff }
h1 { font-size: 1.6rem } h2 { font-size: 1.2rem; margin-top: 2.5rem }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-size: 0.875rem; font-variant-numeric: tabular-nums }
th, td { padding: 0.2rem 0.75rem 0.2rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid #e1e1e1 }
th { border-color: #282828 } .number { text-align: right } td.number { white-space: nowrap }
svg { max-width: 100%; height: auto } footer { margin-top: 2.5rem; color: #787878 }
";

/// `command` is the line that made it.
pub fn page(title: &str, command: &str, sections: &[Section]) -> String {
    let title = escape(title);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n<p><code>{}</code></p>\n",
        escape(command)
    );
    sections.iter().for_each(|section| add(&mut page, section));
    page + &format!("<footer>diptych {}</footer>\n</body>\n</html>\n", env!("CARGO_PKG_VERSION"))
}

fn add(page: &mut String, section: &Section) {
    *page += &format!("<section>\n<h2>{}</h2>\n", escape(section.heading));
    for note in &section.notes {
        *page += &format!("<p>{}</p>\n", escape(note));
    }
    if let Some(table) = &section.table {
        let row = |tag: &str, cells: Vec<&str>| {
            let cell = |(column, text): (usize, &str)| {
                let class = if table.is_numeric(column) { " class=\"number\"" } else { "" };
                format!("<{tag}{class}>{}</{tag}>", escape(text))
            };
            format!("<tr>{}</tr>\n", cells.into_iter().enumerate().map(cell).collect::<String>())
        };
        *page += "<div class=\"wide\"><table>\n";
        *page += &row("th", table.headers.clone());
        table.rows.iter().for_each(|cells| *page += &row("td", cells.iter().map(String::as_str).collect()));
        *page += "</table></div>\n";
    }
    if let Some(figure) = &section.figure {
        *page += &format!("<figure>\n{}\n</figure>\n", figure.trim());
    }
    *page += "</section>\n";
}

/// Text that HTML reads as that text, in elements and in quoted attributes.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_means_itself() {
        assert_eq!(
            escape("<a href=\"x\">'&amp;' à</a>"),
            "&lt;a href=&quot;x&quot;&gt;&#39;&amp;amp;&#39; à&lt;/a&gt;"
        );
    }

    #[test]
    fn a_page_holds_its_sections_in_order_and_only_figures_unescaped() {
        let table = Table { headers: vec!["a<b", "ms"], rows: vec![vec!["<i>".to_owned(), "1.5".to_owned()]] };
        let first = Section { heading: "Costs & time", notes: vec!["p < q".to_owned()], ..Section::default() };
        let figure = Some("<svg></svg>".to_owned());
        let second = Section { heading: "Plot", table: Some(table), figure, ..Section::default() };
        let page = page("scenes/<x>.toml", "diptych \"x\"", &[first, second]);
        let mut rest = page.as_str();
        for part in [
            "<title>scenes/&lt;x&gt;.toml</title>",
            "<code>diptych &quot;x&quot;</code>",
            "<h2>Costs &amp; time</h2>\n<p>p &lt; q</p>",
            "<h2>Plot</h2>",
            "<tr><th>a&lt;b</th><th class=\"number\">ms</th></tr>",
            "<tr><td>&lt;i&gt;</td><td class=\"number\">1.5</td></tr>",
            "<svg></svg>",
            "</html>",
        ] {
            let at = rest.find(part).unwrap_or_else(|| panic!("no `{part}` in\n{rest}"));
            rest = &rest[at + part.len()..];
        }
    }
}
