//! What an experiment leaves: tables, figures and verdicts, as files that the report is made of.

use std::fs;
use std::path::Path;

use ilns_replay::ReplayError;
use serde::{Deserialize, Serialize};

/// One experiment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// `i-a`, ...: the command, and the name of its files.
    pub id: String,
    /// Heading.
    pub title: String,
    /// What was run, in a few sentences.
    pub setting: String,
    /// Seeds, as the table is to say it.
    pub seeds: String,
    /// Version of the program, and commit.
    pub version: String,
    /// Command that gives it again.
    pub command: String,
    /// Wall-clock time, s, and threads.
    pub took: String,
    /// In order.
    pub tables: Vec<Table>,
    /// In order; each lies beside as an SVG file.
    pub figures: Vec<Figure>,
    /// What the paper claims, and what was found.
    pub claims: Vec<Claim>,
}

/// Cells as text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Above it.
    pub caption: String,
    /// First row.
    pub head: Vec<String>,
    /// As many cells as the head.
    pub rows: Vec<Vec<String>>,
    /// Under it.
    pub note: String,
}

/// A picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// Its file in the folder of the results.
    pub file: String,
    /// Under it.
    pub caption: String,
}

/// What became of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// The figures say so too.
    Confirmed,
    /// They do not.
    NotConfirmed,
    /// Neither: the data are not here, or the comparison is not of like with like.
    NotTestable,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// What the paper says.
    pub claim: String,
    /// What became of it.
    pub verdict: Verdict,
    /// The figure that says so.
    pub finding: String,
}

impl Verdict {
    /// In the report.
    pub fn text(self) -> &'static str {
        match self {
            Verdict::Confirmed => "confirmed",
            Verdict::NotConfirmed => "not confirmed",
            Verdict::NotTestable => "not testable",
        }
    }

    /// Confirmed if it `holds`.
    pub fn of(holds: bool) -> Verdict {
        if holds { Verdict::Confirmed } else { Verdict::NotConfirmed }
    }
}

impl Section {
    /// Adds a claim and what was found.
    pub fn claim(&mut self, claim: &str, verdict: Verdict, finding: String) {
        self.claims.push(Claim { claim: claim.to_owned(), verdict, finding });
    }

    /// Writes a picture into `out` and adds it.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn figure(&mut self, out: &Path, name: &str, svg: &str, caption: String) -> Result<(), ReplayError> {
        let file = format!("{}-{name}.svg", self.id);
        write(&out.join(&file), svg)?;
        self.figures.push(Figure { file, caption });
        Ok(())
    }

    /// Writes `ID.json` into `out`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), ReplayError> {
        let text = serde_json::to_string_pretty(self).expect("a section has string keys only") + "\n";
        write(&out.join(format!("{}.json", self.id)), &text)
    }

    /// Reads `ID.json` from `out`; `None` where there is none of this version of the program.
    pub fn read(out: &Path, id: &str) -> Option<Section> {
        let text = fs::read_to_string(out.join(format!("{id}.json"))).ok()?;
        serde_json::from_str(&text).ok()
    }
}

/// Writes a result.
///
/// # Errors
/// A file that cannot be written.
pub fn write(file: &Path, text: &str) -> Result<(), ReplayError> {
    fs::write(file, text).map_err(|source| ReplayError::Io { file: file.to_owned(), action: "write", source })
}
