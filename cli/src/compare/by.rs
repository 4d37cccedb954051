//! Breakdowns of errors, as `--by` lists them.

/// Number of rings if `--by rings` has none.
const RINGS: u16 = 10;

/// Parts of the image whose errors are reported separately.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct By {
    /// Number of rings around the gaze.
    pub rings: Option<u16>,
    pub kind: bool,
    /// First rows of stripes.
    pub seams: Vec<u32>,
}

impl By {
    /// Parses a list such as `rings=8,kind,seams=120,240`. Numbers after `seams=` are further rows.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut by = Self::default();
        for word in text.split(',').map(str::trim) {
            match word.split_once('=').map_or((word, None), |(name, value)| (name, Some(value))) {
                ("rings", _) if by.rings.is_some() => return Err("give rings once".to_owned()),
                ("rings", count) => by.rings = Some(count.map_or(Ok(RINGS), parse_count)?),
                ("kind", None) => by.kind = true,
                ("seams", rows) => by.seams.push(parse_row(rows.unwrap_or_default())?),
                (row, None) if !by.seams.is_empty() && row.starts_with(|c: char| c.is_ascii_digit()) => {
                    by.seams.push(parse_row(row)?);
                }
                _ => return Err("give rings, rings=N, kind or seams=ROW,ROW, or several with commas".to_owned()),
            }
        }
        Ok(by)
    }

    /// Returns each breakdown as `--by` names it, with `true` if it is given.
    pub fn names(&self) -> [(&'static str, bool); 3] {
        [("--by rings", self.rings.is_some()), ("--by kind", self.kind), ("--by seams", !self.seams.is_empty())]
    }
}

fn parse_count(count: &str) -> Result<u16, &'static str> {
    let parsed = count.parse().ok().filter(|count| (1..=1000).contains(count));
    parsed.ok_or("give 1 to 1000 rings, e.g. rings=8")
}

fn parse_row(row: &str) -> Result<u32, &'static str> {
    row.parse().map_err(|_| "give the first rows of stripes, e.g. seams=120,240")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_name_rings_kinds_and_rows() {
        for (text, rings, kind, seams) in [
            ("rings", Some(10), false, &[][..]),
            ("kind,rings=1000", Some(1000), true, &[]),
            ("seams=120,240, kind,rings=8", Some(8), true, &[120, 240]),
            ("seams=7,seams=9", None, false, &[7, 9]),
        ] {
            assert_eq!(By::parse(text), Ok(By { rings, kind, seams: seams.to_vec() }), "{text}");
        }
    }

    #[test]
    fn rejects_lists_with_a_hint() {
        for (text, part) in [
            ("", "give rings"),
            ("ring", "give rings"),
            ("kind=3", "give rings"),
            ("120", "give rings"),
            ("kind,", "give rings"),
            ("rings=0", "rings=8"),
            ("rings=1001", "rings=8"),
            ("rings=x", "rings=8"),
            ("rings=", "rings=8"),
            ("kind=", "give rings"),
            ("rings,rings=8", "once"),
            ("seams", "seams=120,240"),
            ("seams=", "seams=120,240"),
            ("seams=1,99999999999", "seams=120,240"),
            ("seams=-1", "seams=120,240"),
        ] {
            let error = By::parse(text).unwrap_err();
            assert!(error.contains(part) && !error.contains('\n'), "{text}: {error}");
        }
    }
}
