//! `ilns plot`: a picture of a run.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use ilns_recording::{EstimateRow, LogDirectory, read_estimates};
use nav_evaluation::{Pair, Window};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Mode, Time};

use crate::chart;
use crate::error::ReplayError;
use crate::origin;
use crate::output::estimate_file;
use crate::score::score_files;
use crate::thinned::Thinned;

/// Points of a line on the page: more than it has pixels.
const TRACK_POINTS: usize = 2000;
const ERROR_POINTS: usize = 1200;

/// Draws a run as SVG: the trajectory from above and, with a truth, the errors beside their three sigmas.
#[derive(Args, Clone, Debug)]
pub struct PlotArgs {
    /// Folder of a replay, or an estimate.csv.
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// The truth to draw beside it; buoys are taken from the same folder.
    #[arg(long, value_name = "DIR/truth.csv")]
    pub truth: Option<PathBuf>,
    /// The picture.
    #[arg(long, value_name = "FILE")]
    pub svg: PathBuf,
    /// Heading of the picture.
    #[arg(long, value_name = "TEXT", default_value = "Trajectory")]
    pub title: String,
    /// Origin of the ENU frame (degrees, degrees, m), where no `summary.json` or `sensors.toml` says it.
    #[arg(long, value_name = "LAT,LON,H", value_parser = origin::parse, allow_hyphen_values = true)]
    pub origin: Option<[f64; 3]>,
}

/// What is drawn.
#[derive(Debug, Default)]
pub(crate) struct Picture {
    pub(crate) title: String,
    pub(crate) track: Vec<TrackPoint>,
    /// East, north of the truth, m.
    pub(crate) truth: Vec<[f64; 2]>,
    pub(crate) errors: Vec<ErrorSample>,
    /// Number and first position (east, north), m.
    pub(crate) buoys: Vec<(u32, [f64; 2])>,
}

/// A point of the estimated track.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TrackPoint {
    /// Since the first estimate, s.
    pub(crate) t: f64,
    /// East, north, m.
    pub(crate) position_en: [f64; 2],
    pub(crate) mode: u32,
}

/// Error and 1-sigma of position, m.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ErrorSample {
    /// Since the first estimate, s.
    pub(crate) t: f64,
    pub(crate) error_enu: [f64; 3],
    pub(crate) sigma_enu: [f64; 3],
}

impl ErrorSample {
    /// Largest error in sigmas: of a stretch, the sample that matters.
    fn normalised(&self) -> f64 {
        (0..3).map(|axis| self.error_enu[axis].abs() / self.sigma_enu[axis]).fold(0.0, f64::max)
    }
}

/// Reads, draws and writes the picture.
///
/// # Errors
/// A bad file, an unknown origin, no common time.
pub fn run(args: &PlotArgs) -> Result<(), ReplayError> {
    let estimate = estimate_file(&args.out);
    let mut gathering = Gathering::new();
    let mut buoys = Vec::new();
    match &args.truth {
        Some(truth) => {
            let origin = origin::find(args.origin, &estimate, Some(truth))?;
            score_files(&estimate, truth, origin, Window::default(), |row, pairs| gathering.take(row, pairs))?;
            buoys = first_positions(truth, origin)?;
        }
        None => {
            for row in read_estimates(&estimate)? {
                gathering.take(&row?, &[]);
            }
        }
    }
    let picture = gathering.finish(&args.title, buoys);
    if picture.track.is_empty() {
        return Err(ReplayError::NoEstimates { file: estimate });
    }
    fs::write(&args.svg, chart::draw(&picture)).map_err(|source| ReplayError::Io {
        file: args.svg.clone(),
        action: "write",
        source,
    })
}

/// Where each buoy of the truth's folder first was; none where that folder is no log.
fn first_positions(truth: &Path, origin: Geodetic) -> Result<Vec<(u32, [f64; 2])>, ReplayError> {
    let dir = truth.parent().filter(|dir| !dir.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !dir.join("buoys.csv").exists() || !dir.join("imu.csv").exists() {
        return Ok(Vec::new());
    }
    let frame = LocalFrame::new(origin);
    let mut first = BTreeMap::new();
    for fix in LogDirectory::open(dir)?.buoys()? {
        let fix = fix?;
        let position_enu = frame.to_enu(&Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, fix.height));
        if position_enu.iter().all(|x| x.is_finite()) {
            first.entry(fix.buoy).or_insert([position_enu.x, position_enu.y]);
        }
    }
    Ok(first.into_iter().collect())
}

/// Collects what is drawn while the files pass by.
struct Gathering {
    first: Option<Time>,
    track: Thinned<TrackPoint>,
    truth: Thinned<[f64; 2]>,
    errors: Thinned<ErrorSample>,
}

impl Gathering {
    fn new() -> Gathering {
        Gathering {
            first: None,
            // A short outage is not thinned away.
            track: Thinned::new(TRACK_POINTS, |a, b| {
                a.mode == Mode::DeadReckoning as u32 && b.mode != Mode::DeadReckoning as u32
            }),
            truth: Thinned::new(TRACK_POINTS, |_, _| false),
            errors: Thinned::new(ERROR_POINTS, |a, b| a.normalised() > b.normalised()),
        }
    }

    fn take(&mut self, row: &EstimateRow, pairs: &[Pair]) {
        let first = *self.first.get_or_insert(row.t);
        let [east, north, _] = row.position_enu;
        let mode = row.mode.unwrap_or(Mode::Ok as u32);
        self.track.push(TrackPoint { t: (row.t - first).as_seconds(), position_en: [east, north], mode });
        for pair in pairs {
            self.truth.push([pair.truth_position_enu.x, pair.truth_position_enu.y]);
            self.errors.push(ErrorSample {
                t: (pair.estimate.t - first).as_seconds(),
                error_enu: pair.position_error_enu.into(),
                sigma_enu: pair.estimate.sigma_position_enu.into(),
            });
        }
    }

    fn finish(self, title: &str, buoys: Vec<(u32, [f64; 2])>) -> Picture {
        Picture {
            title: title.to_owned(),
            track: self.track.items().to_vec(),
            truth: self.truth.items().to_vec(),
            errors: self.errors.items().to_vec(),
            buoys,
        }
    }
}
