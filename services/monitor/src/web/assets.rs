//! The page's files, part of this executable, and the page as one file.

/// The page.
pub(super) const PAGE: &str = include_str!("../../page/index.html");

/// Where the run stands in a page of one file.
const RUN_MARK: &str = "<!-- the run -->";

/// A file that the page asks for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asset {
    name: &'static str,
    pub(super) mime: &'static str,
    pub(super) text: &'static str,
}

const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! assets {
    ($($mime:ident $name:literal from $path:literal),* $(,)?) => {
        &[$(Asset { name: $name, mime: $mime, text: include_str!(concat!("../../page/", $path)) }),*]
    };
}

/// Every file, in the order in which the page asks for them.
const ASSETS: &[Asset] = assets![
    CSS "uPlot.min.css" from "vendor/uPlot.min.css",
    CSS "style.css" from "style.css",
    SCRIPT "uPlot.iife.min.js" from "vendor/uPlot.iife.min.js",
    SCRIPT "format.js" from "format.js",
    SCRIPT "store.js" from "store.js",
    SCRIPT "map.js" from "map.js",
    SCRIPT "charts.js" from "charts.js",
    SCRIPT "graph.js" from "graph.js",
    SCRIPT "tables.js" from "tables.js",
    SCRIPT "main.js" from "main.js",
];

/// The file of that name.
pub(super) fn find(name: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.name == name)
}

/// The page with everything in it and the run `history` (JSON), to be opened without a server.
pub(crate) fn one_file(history: &str) -> String {
    let mut page = PAGE.to_owned();
    for asset in ASSETS {
        let (asked, whole) = if asset.mime == CSS {
            (
                format!("<link rel=\"stylesheet\" href=\"assets/{}\">", asset.name),
                format!("<style>{}</style>", asset.text),
            )
        } else {
            (format!("<script src=\"assets/{}\"></script>", asset.name), format!("<script>{}</script>", asset.text))
        };
        page = page.replacen(&asked, &whole, 1);
    }
    // In JSON `<` stands in strings only, where it may be written so; then nothing in it ends the script.
    let run = history.replace('<', "\\u003c");
    page.replacen(RUN_MARK, &format!("<script type=\"application/json\" id=\"run\">{run}</script>"), 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_asks_for_every_file_once_and_for_nothing_else() {
        for asset in ASSETS {
            assert_eq!(PAGE.matches(&format!("\"assets/{}\"", asset.name)).count(), 1, "{}", asset.name);
        }
        assert_eq!(PAGE.matches("\"assets/").count(), ASSETS.len());
        for text in ASSETS.iter().map(|asset| asset.text).chain([PAGE]) {
            assert!(!text.contains("src=\"http") && !text.contains("url(http"), "no network");
        }
    }

    #[test]
    fn in_one_file_nothing_is_asked_for_and_a_run_cannot_break_out() {
        let page = one_file("{\"title\":\"</script><script>alert(1)</script>\"}");
        assert!(!page.contains("assets/"), "everything is inside");
        assert!(!page.contains("alert(1)</script>"));
        assert!(page.contains("id=\"run\">{\"title\":\"\\u003c/script>"));
        assert_eq!(page.matches("id=\"run\"").count(), 1);
    }
}
