//! Writes results as one self-contained HTML page. It embeds pictures, charts and its script, and fetches nothing.

use serde::Serialize;

use super::Table;

/// A section of a page: paragraphs, then the figure, then the table.
#[derive(Clone, Debug, Default)]
pub struct Section {
    pub heading: &'static str,
    /// Paragraphs of text.
    pub notes: Vec<String>,
    pub table: Option<Table>,
    /// SVG or HTML, inserted verbatim.
    pub figure: Option<String>,
}

/// Style sheet, and the script that draws the interactive figures, in parts.
const STYLE: &str = include_str!("page.css");
const SCRIPTS: [&str; 3] = [include_str!("lanes.js"), include_str!("timeline.js"), include_str!("page.js")];

/// Content security policy, which forbids the page to fetch anything, even if a figure contains a link to a resource.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// Returns the HTML of a page. `command` is the command line of the run.
pub fn page(title: &str, command: &str, sections: &[Section]) -> String {
    let title = escape(title);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n<p><code>{}</code></p>\n",
        escape(command)
    );
    sections.iter().for_each(|section| add(&mut page, section));
    let footer = format!("<footer>diptych {}</footer>", env!("CARGO_PKG_VERSION"));
    let script = SCRIPTS.concat();
    page + &format!("{footer}\n<script>\n\"use strict\";\n(() => {{\n{script}}})();\n</script>\n</body>\n</html>\n")
}

/// Returns a figure that the page's script draws from data. `kind` names the function in `page.js` or its parts.
///
/// # Errors
/// [`serde_json::Error`] if `data` cannot be serialized to JSON.
pub fn live(kind: &str, data: &impl Serialize) -> serde_json::Result<String> {
    // Escape `<`, so that no string can close the script element.
    let json = serde_json::to_string(data)?.replace('<', "\\u003c");
    Ok(format!("<div class=\"live\" data-kind=\"{kind}\"><script type=\"application/json\">{json}</script></div>"))
}

/// Cells with more characters than this get a minimum width, so that they do not wrap after each word.
const LONG: usize = 24;
/// Tables with more columns than this are set in small type, so that they fit on a page.
const MANY: usize = 12;

fn add(page: &mut String, section: &Section) {
    *page += &format!("<section>\n<h2>{}</h2>\n", escape(section.heading));
    for note in &section.notes {
        *page += &format!("<p>{}</p>\n", escape(note));
    }
    if let Some(figure) = &section.figure {
        *page += &format!("<figure class=\"wide\">\n{}\n</figure>\n", figure.trim());
    }
    if let Some(table) = &section.table {
        let row = |tag: &str, cells: Vec<&str>| {
            let cell = |(column, text): (usize, &str)| {
                let is_long = text.chars().count() > LONG;
                let class = match (table.is_numeric(column), is_long) {
                    (true, _) => " class=\"number\"",
                    (false, true) => " class=\"long\"",
                    (false, false) => "",
                };
                // Long headers break after underscores.
                let text = if tag == "th" { escape(text).replace('_', "_<wbr>") } else { escape(text) };
                format!("<{tag}{class}>{text}</{tag}>")
            };
            format!("<tr>{}</tr>\n", cells.into_iter().enumerate().map(cell).collect::<String>())
        };
        let class = if table.headers.len() > MANY { " class=\"dense\"" } else { "" };
        *page += &format!("<div class=\"wide\"><table{class}>\n");
        *page += &row("th", table.headers.clone());
        table.rows.iter().for_each(|cells| *page += &row("td", cells.iter().map(String::as_str).collect()));
        *page += "</table></div>\n";
    }
    *page += "</section>\n";
}

/// Escapes text for HTML elements and quoted attributes.
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
    fn escaped_text_means_itself() {
        assert_eq!(
            escape("<a href=\"x\">'&amp;' à</a>"),
            "&lt;a href=&quot;x&quot;&gt;&#39;&amp;amp;&#39; à&lt;/a&gt;"
        );
    }

    #[test]
    fn data_cannot_end_its_element() {
        let figure = live("kind", &["</script><b>"]).unwrap();
        assert_eq!((figure.matches("</script>").count(), figure.contains("<b>")), (1, false), "{figure}");
        let json = figure.split_once("json\">").unwrap().1.split_once("</script>").unwrap().0;
        assert_eq!(serde_json::from_str::<Vec<String>>(json).unwrap(), ["</script><b>"]);
    }

    #[test]
    fn page_keeps_section_order_and_escapes_text() {
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
            "<svg></svg>",
            "<tr><th>a&lt;b</th><th class=\"number\">ms</th></tr>",
            "<tr><td>&lt;i&gt;</td><td class=\"number\">1.5</td></tr>",
            "</html>",
        ] {
            let at = rest.find(part).unwrap_or_else(|| panic!("no `{part}` in\n{rest}"));
            rest = &rest[at + part.len()..];
        }
    }
}
