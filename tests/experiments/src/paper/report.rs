//! `report.html`, one file that needs no network, and `report.md`: the same tables, figures and verdicts.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use ilns_replay::ReplayError;

use super::section::{Section, Table, Verdict, write as write_file};

const TITLE: &str = "FGO-ILNS on the bench";
const INTRODUCTION: &str = "The experiments of the paper (Song, Li, Liu, Zhu: FGO-ILNS, tightly coupled multi-sensor integrated navigation \
    based on factor graph optimization for AUV) with this estimator and with filters on the same sensor models. Figures are mean ± spread \
    of one seed. The paper's trajectory and seeds are not published: the motion here has the manoeuvres and lengths that it names, so that \
    a ratio to its figures is indicative. Where its equations had to be corrected stands in navigation/ERRATA.md.";

/// Writes both into `out`.
///
/// # Errors
/// A figure that cannot be read, a file that cannot be written.
pub fn write(out: &Path, sections: &[Section]) -> Result<(), ReplayError> {
    write_file(&out.join("report.md"), &markdown(sections))?;
    let html = html(sections, |file| {
        let file = out.join(file);
        fs::read_to_string(&file).map_err(|source| ReplayError::Io { file, action: "read", source })
    })?;
    write_file(&out.join("report.html"), &html)
}

fn provenance(section: &Section) -> String {
    format!("{}; version {}; {}", section.seeds, section.version, section.took)
}

fn markdown(sections: &[Section]) -> String {
    let mut text = format!("# {TITLE}\n\n{INTRODUCTION}\n\n## What became of the paper's claims\n\n");
    text += &markdown_table(&claims(sections));
    for section in sections {
        add(&mut text, format_args!("\n## {}\n\n{}\n\n", section.title, section.setting));
        add(&mut text, format_args!("```\n{}\n```\n\n{}.\n", section.command, provenance(section)));
        for table in &section.tables {
            add(&mut text, format_args!("\n**{}**\n\n{}", table.caption, markdown_table(table)));
            if !table.note.is_empty() {
                add(&mut text, format_args!("\n{}\n", table.note));
            }
        }
        for figure in &section.figures {
            add(&mut text, format_args!("\n![{}]({})\n\n*{}*\n", figure.caption, figure.file, figure.caption));
        }
    }
    text
}

fn markdown_table(table: &Table) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(&table.head) + "|" + &"---|".repeat(table.head.len()) + "\n";
    table.rows.iter().for_each(|row| text += &line(row));
    text
}

/// One row per claim.
fn claims(sections: &[Section]) -> Table {
    let rows = sections.iter().flat_map(|section| section.claims.iter().map(move |claim| (section, claim)));
    Table {
        caption: "What became of the paper's claims".to_owned(),
        head: ["", "the paper", "verdict", "found here"].map(str::to_owned).into(),
        rows: rows
            .map(|(section, claim)| {
                let number = section.id.to_uppercase();
                vec![number, claim.claim.clone(), claim.verdict.text().to_owned(), claim.finding.clone()]
            })
            .collect(),
        note: String::new(),
    }
}

/// `figure` gives the SVG text of a file.
fn html(sections: &[Section], figure: impl Fn(&str) -> Result<String, ReplayError>) -> Result<String, ReplayError> {
    let mut text = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{TITLE}</title>\n<style>\n{STYLE}</style>\n\
         </head>\n<body>\n<main>\n<h1>{TITLE}</h1>\n<p>{}</p>\n<nav><a href=\"#claims\">Claims</a>",
        escape(INTRODUCTION)
    );
    for section in sections {
        let name = section.title.split(':').next().unwrap_or(&section.title);
        add(&mut text, format_args!(" <a href=\"#{}\">{}</a>", section.id, escape(name)));
    }
    text += "</nav>\n<h2 id=\"claims\">What became of the paper's claims</h2>\n<ul class=\"claims\">\n";
    for section in sections {
        for claim in &section.claims {
            let class = match claim.verdict {
                Verdict::Confirmed => "confirmed",
                Verdict::NotConfirmed => "not-confirmed",
                Verdict::NotTestable => "not-testable",
            };
            add(
                &mut text,
                format_args!(
                    "<li><a href=\"#{}\">{}</a> <q>{}</q> <strong class=\"{class}\">{}</strong> {}</li>\n",
                    section.id,
                    escape(&section.id.to_uppercase()),
                    escape(&claim.claim),
                    claim.verdict.text(),
                    prose(&claim.finding)
                ),
            );
        }
    }
    text += "</ul>\n";
    for section in sections {
        add(&mut text, format_args!("<section id=\"{}\">\n<h2>{}</h2>\n", section.id, escape(&section.title)));
        add(&mut text, format_args!("<p>{}</p>\n", prose(&section.setting)));
        add(&mut text, format_args!("<pre>{}</pre>\n", escape(&section.command)));
        add(&mut text, format_args!("<p class=\"small\">{}.</p>\n", escape(&provenance(section))));
        section.tables.iter().for_each(|table| text += &html_table(table));
        for picture in &section.figures {
            let svg = figure(&picture.file)?;
            let caption = escape(&picture.caption);
            add(
                &mut text,
                format_args!("<figure><div class=\"wide\">{svg}</div><figcaption>{caption}</figcaption></figure>\n"),
            );
        }
        text += "</section>\n";
    }
    text += "</main>\n</body>\n</html>\n";
    Ok(text)
}

fn html_table(table: &Table) -> String {
    let cells = |tag: &str, cells: &[String]| -> String {
        cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect()
    };
    let mut text = format!("<h3>{}</h3>\n<div class=\"wide\"><table>\n<thead><tr>", escape(&table.caption));
    add(&mut text, format_args!("{}</tr></thead>\n<tbody>\n", cells("th", &table.head)));
    for row in &table.rows {
        add(&mut text, format_args!("<tr>{}</tr>\n", cells("td", row)));
    }
    text += "</tbody></table></div>\n";
    if !table.note.is_empty() {
        add(&mut text, format_args!("<p class=\"small\">{}</p>\n", prose(&table.note)));
    }
    text
}

fn add(text: &mut String, arguments: std::fmt::Arguments<'_>) {
    text.write_fmt(arguments).expect("a String takes everything");
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Escaped, with what stands between backticks as code.
fn prose(text: &str) -> String {
    let parts = escape(text);
    let parts = parts.split('`').enumerate();
    parts.map(|(at, part)| if at % 2 == 1 { format!("<code>{part}</code>") } else { part.to_owned() }).collect()
}

/// Verdicts are told apart by their words first; figures that a telephone would make too small to read can be pushed aside.
const STYLE: &str = "\
body { font: 16px/1.5 Georgia, 'Times New Roman', serif; color: #222222; background: #ffffff; margin: 0; }
main { max-width: 60rem; margin: 0 auto; padding: 1rem; }
h1, h2, h3, table, nav, figcaption, .small, strong { font-family: Helvetica, Arial, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; }
h2 { font-size: 1.3rem; margin-top: 2.5rem; border-bottom: 1px solid #999999; }
h3 { font-size: 1rem; margin: 1.5rem 0 0.4rem; }
nav { display: flex; flex-wrap: wrap; gap: 0.3rem 1rem; font-size: 0.9rem; }
a { color: #0072B2; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; background: #f4f4f4; padding: 0.5rem; font-size: 0.8rem; }
.small, figcaption { font-size: 0.85rem; color: #444444; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; }
th { text-align: left; vertical-align: bottom; border-bottom: 2px solid #444444; padding: 0.25rem 0.7rem 0.25rem 0; }
td { border-bottom: 1px solid #dddddd; padding: 0.2rem 0.7rem 0.2rem 0; white-space: nowrap; }
ul.claims { padding-left: 0; list-style: none; }
ul.claims li { margin-bottom: 0.8rem; }
strong { font-size: 0.8rem; padding: 0.1rem 0.4rem; border: 1px solid; border-radius: 0.2rem; white-space: nowrap; }
strong.confirmed { color: #00654a; } strong.not-confirmed { color: #a34700; } strong.not-testable { color: #555555; }
figure { margin: 1.5rem 0; }
figure svg { display: block; width: 100%; min-width: 34rem; max-width: 46rem; height: auto; }
@media print { main { max-width: none; } figure, table, li { break-inside: avoid; } figure svg { min-width: 0; max-width: 100%; } nav { display: none; } }
";

#[cfg(test)]
mod tests {
    use super::super::section::Figure;
    use super::*;

    fn section() -> Section {
        let mut section = Section {
            id: "i-a".to_owned(),
            title: "I-a: windows".to_owned(),
            tables: vec![Table {
                caption: "RMS".to_owned(),
                head: vec!["window".to_owned(), "E < N".to_owned()],
                rows: vec![vec!["20".to_owned(), "0.1 ± 0.0".to_owned()]],
                note: String::new(),
            }],
            figures: vec![Figure { file: "i-a-rms.svg".to_owned(), caption: "bars".to_owned() }],
            ..Section::default()
        };
        section.claim("17 m", Verdict::NotConfirmed, "0.2 m".to_owned());
        section
    }

    #[test]
    fn the_page_holds_everything_and_loads_nothing() {
        let html = html(&[section()], |file| Ok(format!("<svg>{file}</svg>"))).expect("the figure is there");
        for part in ["E &lt; N", "<svg>i-a-rms.svg</svg>", "not confirmed", "<q>17 m</q>", "href=\"#i-a\""] {
            assert!(html.contains(part), "{part}");
        }
        for outside in ["http://", "https://", "src=", "@import", "<script"] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn the_text_has_the_same_tables_and_verdicts() {
        let text = markdown(&[section()]);
        assert!(text.contains("| window | E < N |\n|---|---|\n| 20 | 0.1 ± 0.0 |\n"), "{text}");
        assert!(text.contains("| I-A | 17 m | not confirmed | 0.2 m |"), "{text}");
        assert!(text.contains("![bars](i-a-rms.svg)"), "{text}");
    }
}
