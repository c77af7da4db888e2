//! Trajectories in TUM format: ours, and anybody's, against a truth; and the same figures from `evo`.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Parser;
use ilns_recording::{LogWriter, LogWriterOptions, read_truth};
use ilns_replay::{Alignment, ReplayArgs, ReplayError, TrajectoryArgs, replay, score_trajectory};
use nav_evaluation::{Distances, Window};
use nav_geometry::{Geodetic, LocalFrame};
use sim_world::{Preset, Scenario, World};
use tempfile::TempDir;

#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    replay: ReplayArgs,
}

/// A minute of a mission: the log, its replay, and its truth in TUM format.
struct Run {
    folder: TempDir,
    origin: Geodetic,
}

impl Run {
    fn new() -> Run {
        let folder = tempfile::tempdir().unwrap();
        let text = include_str!("../../../tests/short.toml");
        let scenario = Scenario::parse(text, Path::new("short.toml")).unwrap();
        let world = World::new(&scenario, Preset::Realistic, 3).unwrap();
        let log = folder.path().join("log");
        let mut writer = LogWriter::create(&log, LogWriterOptions::default()).unwrap();
        writer.sensors_toml(&world.sensors_toml()).unwrap();
        world.readings().for_each(|reading| writer.reading(&reading).unwrap());
        world.truth_rows(10.0).for_each(|row| writer.truth(&row).unwrap());
        writer.finish().unwrap();
        let out = folder.path().join("out");
        let args = ["replay", log.to_str().unwrap(), "--out", out.to_str().unwrap()];
        replay::run(&Cli::parse_from(args).replay).unwrap();
        let [lat, lon, height] = scenario.origin_deg;
        let run = Run { folder, origin: Geodetic::from_degrees(lat, lon, height) };
        fs::write(run.path("truth.tum"), run.truth_tum()).unwrap();
        run
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn truth_tum(&self) -> String {
        let frame = LocalFrame::new(self.origin);
        read_truth(self.path("log/truth.csv")).unwrap().fold(String::new(), |mut text, row| {
            let row = row.unwrap();
            let p = frame.to_enu(&Geodetic::from_degrees(row.lat_deg, row.lon_deg, row.height));
            let [w, x, y, z] = row.q_enu_body;
            let t = row.header.t_valid;
            let (seconds, nanos) = (t / 1_000_000_000, t % 1_000_000_000);
            writeln!(text, "{seconds}.{nanos:09} {} {} {} {x} {y} {z} {w}", p.x, p.y, p.z).unwrap();
            text
        })
    }

    fn score(&self, tum: &str, truth: &str, args: TrajectoryArgs) -> Result<ilns_replay::TrajectoryScore, ReplayError> {
        score_trajectory(&self.path(tum), &self.path(truth), None, Window::default(), &args)
    }
}

fn aligned(align: Alignment) -> TrajectoryArgs {
    TrajectoryArgs { align, ..TrajectoryArgs::default() }
}

/// `evo_ape` or `evo_rpe`, where it is installed.
fn evo(command: &str, run: &Run, options: &[&str]) -> Option<Distances> {
    let (truth, estimate) = (run.path("truth.tum"), run.path("out/estimate.tum"));
    let output = Command::new(command)
        .args(["tum", truth.to_str().unwrap(), estimate.to_str().unwrap()])
        .args(options)
        // Its settings are made anew, in the folder of the test.
        .env("HOME", run.folder.path())
        .env("MPLBACKEND", "Agg")
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    let figure = |name: &str| -> f64 {
        let of_line = |line: &str| line.trim().strip_prefix(name).map(|rest| rest.trim().parse().unwrap());
        text.lines().find_map(of_line).unwrap_or_else(|| panic!("no {name} in {text}"))
    };
    let [rmse, mean, median, min, max] = ["rmse", "mean", "median", "min", "max"].map(figure);
    Some(Distances { count: 0, rmse, mean, median, min, max })
}

fn assert_same(ours: &Distances, evos: &Distances) {
    let figures = |d: &Distances| [d.rmse, d.mean, d.median, d.min, d.max];
    for (our, evo) in figures(ours).into_iter().zip(figures(evos)) {
        assert!((our - evo).abs() < 1e-6, "{ours:?} against {evos:?}");
    }
}

#[test]
fn evo_finds_the_same_errors_in_our_trajectory() {
    let run = Run::new();
    let Some(ape) = evo("evo_ape", &run, &[]) else {
        eprintln!("skipped: evo is not installed (pip install evo)");
        return;
    };
    let ours = run.score("out/estimate.tum", "log/truth.csv", TrajectoryArgs::default()).unwrap();
    assert!(ours.ate.count > 500 && ours.ate.rmse > 1e-3, "{ours:?}");
    assert_same(&ours.ate, &ape);
    let ours = run.score("out/estimate.tum", "log/truth.csv", aligned(Alignment::Se3)).unwrap();
    assert_same(&ours.ate, &evo("evo_ape", &run, &["--align"]).unwrap());
    let with_rpe = TrajectoryArgs { rpe: Some(5.0), ..TrajectoryArgs::default() };
    let ours = run.score("out/estimate.tum", "log/truth.csv", with_rpe).unwrap();
    let rpe = evo("evo_rpe", &run, &["--delta", "5", "--delta_unit", "m"]).unwrap();
    assert_same(&ours.rpe.unwrap(), &rpe);
}

#[test]
fn a_truth_scores_the_same_as_csv_and_as_a_second_trajectory() {
    let run = Run::new();
    let of_csv = run.score("out/estimate.tum", "log/truth.csv", TrajectoryArgs::default()).unwrap();
    let of_tum = run.score("out/estimate.tum", "truth.tum", TrajectoryArgs::default()).unwrap();
    assert!((of_csv.ate.rmse - of_tum.ate.rmse).abs() < 1e-9, "{of_csv:?} {of_tum:?}");
    assert!(of_csv.table().contains("absolute error (ATE), m"), "{}", of_csv.table());
}

#[test]
fn a_trajectory_in_a_frame_of_its_own_is_scored_after_alignment_even_without_an_origin() {
    let run = Run::new();
    // Turned by 90 degrees about up and moved, as a system says that knows no north: (x, y) becomes (-y, x).
    let text = fs::read_to_string(run.path("out/estimate.tum")).unwrap();
    let turned: String = text
        .lines()
        .map(|line| {
            let cells: Vec<f64> = line.split(' ').skip(1).map(|cell| cell.parse().unwrap()).collect();
            let t = line.split(' ').next().unwrap();
            format!("{t} {} {} {} 0 0 0 1\n", 100.0 - cells[1], 200.0 + cells[0], 5.0 + cells[2])
        })
        .collect();
    fs::create_dir(run.path("slam")).unwrap();
    fs::write(run.path("slam/slam.tum"), turned).unwrap();
    fs::create_dir(run.path("reference")).unwrap();
    fs::copy(run.path("log/truth.csv"), run.path("reference/truth.csv")).unwrap();
    let in_place = run.score("out/estimate.tum", "truth.tum", aligned(Alignment::Yaw)).unwrap().ate.rmse;
    let fitted = run.score("slam/slam.tum", "reference/truth.csv", aligned(Alignment::Yaw)).unwrap().ate.rmse;
    assert!((in_place - fitted).abs() < 1e-6, "{in_place} {fitted}");
    let as_it_is = run.score("slam/slam.tum", "truth.tum", TrajectoryArgs::default()).unwrap().ate.rmse;
    assert!(as_it_is > 100.0, "{as_it_is}");
    let error = run.score("slam/slam.tum", "reference/truth.csv", TrajectoryArgs::default()).unwrap_err();
    assert!(matches!(error, ReplayError::NoOrigin { .. }), "{error}");
}

#[test]
fn what_cannot_be_scored_is_told_in_one_line() {
    let run = Run::new();
    let refused = |text: &str, args: TrajectoryArgs| {
        fs::write(run.path("bad.tum"), text).unwrap();
        let message = run.score("bad.tum", "truth.tum", args).unwrap_err().to_string();
        assert_eq!(message.lines().count(), 1, "{message}");
        message
    };
    let none = refused("9000 0 0 0 0 0 0 1\n9001 0 0 0 0 0 0 1\n", TrajectoryArgs::default());
    assert!(none.contains("no poses within 0.01 s of each other: 9000 to 9001 s against"), "{none}");
    let quaternion = refused("10 0 0 0 0 0 0 0\n", TrajectoryArgs::default());
    assert!(quaternion.contains("bad.tum:1: the quaternion has the length 0.000"), "{quaternion}");
    let short = refused("10 0 0 0 0 0 0 1\n", TrajectoryArgs { rpe: Some(100.0), ..TrajectoryArgs::default() });
    assert!(short.contains("shorter than a stretch of 100 m"), "{short}");
}
