//! Where the ENU frame of an estimate file lies: the command line says it, or `summary.json`, or `sensors.toml`.

use std::fs;
use std::path::Path;

use ilns_recording::{SUMMARY_FILE, Summary};
use ilns_runtime::RuntimeError;
use nav_geometry::Geodetic;
use shared_types::{Config, ConfigText};

use crate::error::ReplayError;

/// `LAT,LON,H` in degrees, degrees, m.
pub(crate) fn parse(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[lat, lon, height]) if lat.abs() <= 90.0 && lon.abs() <= 360.0 => Ok([lat, lon, height]),
        _ => Err("expected latitude, longitude in degrees and height in m, such as 36.38,127.36,0".to_owned()),
    }
}

/// The origin of the frame of `estimate`; `given` comes first, then `summary.json` beside it, then `sensors.toml` beside `truth`.
pub(crate) fn find(given: Option<[f64; 3]>, estimate: &Path, truth: Option<&Path>) -> Result<Geodetic, ReplayError> {
    if let Some([lat, lon, height]) = given {
        return Ok(Geodetic::from_degrees(lat, lon, height));
    }
    let summary = estimate.with_file_name(SUMMARY_FILE);
    if summary.exists() {
        let [lat, lon, height] = Summary::read(&summary)?.origin;
        return Ok(Geodetic::from_degrees(lat, lon, height));
    }
    let config = truth.map(|truth| truth.with_file_name("sensors.toml")).filter(|file| file.exists());
    if let Some(file) = config {
        let text = fs::read_to_string(&file).map_err(|source| ReplayError::Io {
            file: file.clone(),
            action: "read",
            source,
        })?;
        let config = Config::load(&[ConfigText { file, text }], &[]).map_err(RuntimeError::from)?;
        if let Some([latitude, longitude, height]) = config.vehicle.frame.origin_geodetic {
            return Ok(Geodetic::new(latitude, longitude, height));
        }
    }
    Err(ReplayError::NoOrigin { estimate: estimate.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_origin_is_three_numbers_in_their_ranges() {
        assert_eq!(parse("36.38, 127.36,-2"), Ok([36.38, 127.36, -2.0]));
        for text in ["36.38,127.36", "127.36,400,0", "a,b,c", "nan,0,0", "1,2,3,4"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sensors_toml_beside_the_truth_stands_in_for_a_missing_summary() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        fs::write(dir.path().join("sensors.toml"), "[frame]\norigin = [10.0, 20.0, 5.0]\n").expect("it can be written");
        let (estimate, truth) = (dir.path().join("out/estimate.csv"), dir.path().join("truth.csv"));
        let found = find(None, &estimate, Some(&truth)).expect("an origin");
        assert_eq!(found, Geodetic::from_degrees(10.0, 20.0, 5.0));
        let error = find(None, &estimate, None).expect_err("nothing says it");
        assert!(matches!(error, ReplayError::NoOrigin { .. }), "{error}");
    }
}
