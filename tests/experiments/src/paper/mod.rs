//! The paper's experiments, each a command, and a report of them all.
//!
//! Every experiment leaves `ID.json` and its figures in one folder; the report is made of what lies there, so that one experiment can
//! be run again without the others.

mod added_sensors;
mod anchoring;
mod bench;
mod ekf_comparison;
mod outage;
mod printed;
mod recorded;
mod report;
mod section;
mod smoother_gain;
mod spread;
mod window_size;
mod withheld;

use std::fs;

use ilns_replay::ReplayError;

pub use bench::{Args, BenchError};
use section::Section;

type Run = fn(&Args) -> Result<Section, BenchError>;

/// One of the paper's experiments, or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// Length of the window.
    WindowSize,
    /// EKF beside FGO.
    EkfComparison,
    /// Further sensors.
    AddedSensors,
    /// Outage.
    Outage,
    /// PF, FPF, FBPF.
    Anchoring,
    /// Recorded drives.
    Recorded,
    /// What the smoother buys.
    SmootherGain,
    /// Each of them.
    All,
}

/// In the order of the report.
const EXPERIMENTS: [(&str, Experiment, Run); 7] = [
    ("i-a", Experiment::WindowSize, window_size::run),
    ("i-b", Experiment::EkfComparison, ekf_comparison::run),
    ("ii-a", Experiment::AddedSensors, added_sensors::run),
    ("ii-b", Experiment::Outage, outage::run),
    ("pf", Experiment::Anchoring, anchoring::run),
    ("smoother-gain", Experiment::SmootherGain, smoother_gain::run),
    ("iii", Experiment::Recorded, recorded::run),
];

/// Runs it, and makes the report of all results in the folder anew.
///
/// # Errors
/// A trial that cannot be run, a file that cannot be read or written.
pub fn run(experiment: Experiment, args: &Args) -> Result<(), BenchError> {
    fs::create_dir_all(&args.out).map_err(|source| ReplayError::Io {
        file: args.out.clone(),
        action: "make the folder",
        source,
    })?;
    for (_, each, run) in EXPERIMENTS {
        if experiment == each || experiment == Experiment::All {
            run(args)?;
        }
    }
    let sections: Vec<Section> = EXPERIMENTS.iter().filter_map(|(id, ..)| Section::read(&args.out, id)).collect();
    report::write(&args.out, &sections)?;
    eprintln!("{} and report.md beside it", args.out.join("report.html").display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    #[test]
    fn the_errata_name_tests_that_exist() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let text = std::fs::read_to_string(root.join("navigation/ERRATA.md")).expect("the page is there");
        let mut named = 0;
        // `file.rs`: `name of a test`
        for part in text.split("`: `").collect::<Vec<&str>>().windows(2) {
            let file = part[0].rsplit('`').next().expect("a file stands before the colon");
            let test = part[1].split('`').next().expect("a test stands behind it");
            let file =
                ["navigation", "."].map(|folder| root.join(folder).join(file)).into_iter().find(|file| file.exists());
            let source =
                std::fs::read_to_string(file.unwrap_or_else(|| panic!("no file for {test}"))).expect("it is text");
            assert!(source.contains(&format!("fn {test}()")), "{test}");
            named += 1;
        }
        assert!(named > 15, "{named}");
    }
}
