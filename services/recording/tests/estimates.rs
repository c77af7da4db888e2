//! `estimate.csv` and `estimate.tum`: what is written, what is refused, and when a file counts as whole.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::fs;

use ilns_recording::{EstimateWriter, LogError, read_estimates};
use shared_types::{Header, Mode, NavEstimate, Time};

fn estimate(t: i64) -> NavEstimate {
    NavEstimate {
        header: Header::at(Time(t)),
        solution: 42,
        t_keyframe: t - 500_000_000,
        position_enu: [12.345_678_9, -0.000_001_4, -101.5],
        velocity_enu: [0.5, -0.25, 0.125],
        q_enu_body: [0.5, -0.5, 0.5, -0.5],
        accel_bias: [1e-3, -2e-3, 3e-3],
        gyro_bias: [1.25e-6, 0.0, -3e-7],
        position_cov: [0.04, 0.0, 0.0, 0.09, 0.0, 0.0001],
        velocity_cov: [1e-4, 0.0, 0.0, 4e-4, 0.0, 9e-4],
        attitude_cov: [1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-6],
        sigma_rpy: [0.1_f64.to_radians(), 0.2_f64.to_radians(), 1.5_f64.to_radians()],
        lat_lon_h: [36.380_123_456_78, 127.36, -101.5],
        aiding_age: [f64::INFINITY; 5],
        mode: Mode::Degraded as u32,
        reserved: 0,
    }
}

#[test]
fn the_header_is_that_of_the_format_and_a_row_is_read_back() {
    let out = tempfile::tempdir().unwrap();
    let mut writer = EstimateWriter::create(out.path()).unwrap();
    writer.write(&estimate(1_746_099_142_369_755_001)).unwrap();
    writer.finish().unwrap();

    let csv = fs::read_to_string(out.path().join("estimate.csv")).unwrap();
    let format = "t,e,n,u,qw,qx,qy,qz,ve,vn,vu,bax,bay,baz,bgx,bgy,bgz,se,sn,su,sroll,spitch,syaw,lat,lon,h";
    assert!(csv.starts_with(&format!("{format},mode,solution,t_keyframe,sve,svn,svu\n")), "{csv}");

    let row = read_estimates(out.path().join("estimate.csv")).unwrap().next().unwrap().unwrap();
    assert_eq!(row.t, Time(1_746_099_142_369_755_001));
    assert_eq!(row.t_keyframe, Some(Time(1_746_099_141_869_755_001)));
    assert_eq!((row.mode, row.solution), (Some(2), Some(42)));
    assert_eq!(row.position_enu, [12.345_679, -0.000_001, -101.5]);
    assert_eq!(row.q_enu_body, [0.5, -0.5, 0.5, -0.5]);
    assert_eq!(row.velocity_enu, [0.5, -0.25, 0.125]);
    assert_eq!((row.accel_bias, row.gyro_bias), ([1e-3, -2e-3, 3e-3], [1.25e-6, 0.0, -3e-7]));
    assert_eq!(row.sigma_position_enu, [0.2, 0.3, 0.01]);
    assert_eq!(row.sigma_velocity_enu, [0.01, 0.02, 0.03]);
    assert_eq!(row.sigma_rpy_deg, [0.1, 0.2, 1.5]);
    assert_eq!(row.lat_lon_h, [36.380_123_456_78, 127.36, -101.5]);
}

#[test]
fn the_tum_file_puts_w_last() {
    let out = tempfile::tempdir().unwrap();
    let mut writer = EstimateWriter::create(out.path()).unwrap();
    writer.write(&NavEstimate { q_enu_body: [0.1, 0.2, 0.3, 0.9], ..estimate(1_500_000_000) }).unwrap();
    writer.finish().unwrap();
    let tum = fs::read_to_string(out.path().join("estimate.tum")).unwrap();
    assert_eq!(tum, "1.5 12.345679 -0.000001 -101.500000 0.200000000 0.300000000 0.900000000 0.100000000\n");
}

#[test]
fn initialising_estimates_are_not_written() {
    let out = tempfile::tempdir().unwrap();
    let mut writer = EstimateWriter::create(out.path()).unwrap();
    // While initialising, nothing needs to be known.
    let start = NavEstimate { mode: Mode::Initialising as u32, position_enu: [f64::NAN; 3], ..estimate(0) };
    writer.write(&start).unwrap();
    writer.write(&estimate(5_000_000)).unwrap();
    assert_eq!(writer.rows(), 1);
    writer.finish().unwrap();
    assert_eq!(read_estimates(out.path().join("estimate.csv")).unwrap().count(), 1);
}

#[test]
fn a_number_that_is_not_finite_is_never_written() {
    let out = tempfile::tempdir().unwrap();
    let bad: [(&str, NavEstimate); 4] = [
        ("position", NavEstimate { position_enu: [0.0, f64::NAN, 0.0], ..estimate(0) }),
        ("position sigma", NavEstimate { position_cov: [-1e-9, 0.0, 0.0, 1.0, 0.0, 1.0], ..estimate(0) }),
        ("attitude sigma", NavEstimate { sigma_rpy: [0.0, 0.0, f64::INFINITY], ..estimate(0) }),
        ("latitude", NavEstimate { lat_lon_h: [f64::NAN; 3], ..estimate(0) }),
    ];
    for (word, estimate) in bad {
        let mut writer = EstimateWriter::create(out.path()).unwrap();
        let error = writer.write(&estimate).unwrap_err();
        assert!(matches!(error, LogError::EstimateNotFinite { .. }) && error.to_string().contains(word), "{error}");
        writer.finish().unwrap();
        assert_eq!(read_estimates(out.path().join("estimate.csv")).unwrap().count(), 0, "{word}");
    }
}

#[test]
fn a_run_that_breaks_off_leaves_nothing_that_looks_whole() {
    let out = tempfile::tempdir().unwrap();
    let mut earlier = EstimateWriter::create(out.path()).unwrap();
    earlier.write(&estimate(0)).unwrap();
    earlier.finish().unwrap();

    let mut broken = EstimateWriter::create(out.path()).unwrap();
    broken.write(&estimate(0)).unwrap();
    broken.flush().unwrap();
    drop(broken);
    let mut names: Vec<String> =
        fs::read_dir(out.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["estimate.csv.partial", "estimate.tum.partial"]);
}
