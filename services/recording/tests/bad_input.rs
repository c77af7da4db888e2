//! Every way in which a log can be wrong gives one line that names file, line, column and the mend.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::fs;

use ilns_recording::{LogDirectory, LogError, read_estimates};
use tempfile::TempDir;

const IMU: &str = "t,wx,wy,wz,fx,fy,fz\n0.000,0,0,0,0,0,9.8\n0.005,0,0,0,0,0,9.8\n";

/// A folder with a sound `imu.csv` and the given files, which may replace it.
fn log(files: &[(&str, &str)]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("imu.csv"), IMU).unwrap();
    for (name, text) in files {
        fs::write(dir.path().join(name), text).unwrap();
    }
    dir
}

/// The message for the first thing wrong with the log, without the folder's own path.
fn message(dir: &TempDir) -> String {
    let error = LogDirectory::open(dir.path())
        .and_then(|log| log.merged())
        .and_then(|merged| merged.collect::<Result<Vec<_>, _>>())
        .expect_err("the log is bad");
    plain(dir, &error)
}

fn plain(dir: &TempDir, error: &LogError) -> String {
    let text = error.to_string();
    assert!(!text.contains('\n'), "one line: {text}");
    text.replace(&format!("{}/", dir.path().display()), "").replace(&dir.path().display().to_string(), "LOG")
}

#[test]
fn a_missing_directory_and_a_file_in_its_place_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let missing = LogDirectory::open(dir.path().join("nowhere")).unwrap_err();
    assert_eq!(
        plain(&dir, &missing),
        "nowhere: there is no such directory (a log is a folder with at least `imu.csv`)"
    );
    let file = dir.path().join("imu.csv");
    fs::write(&file, IMU).unwrap();
    let not_a_directory = LogDirectory::open(&file).unwrap_err();
    assert_eq!(
        plain(&dir, &not_a_directory),
        "imu.csv: this is not a directory (give the folder that holds `imu.csv`)"
    );
}

#[test]
fn a_log_without_imu_says_what_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("ps.csv"), "t,depth\n0,1\n").unwrap();
    assert_eq!(
        message(&dir),
        "LOG: the log has no `imu.csv`, without which there is nothing to navigate by (expected columns: t,wx,wy,wz,fx,fy,fz)"
    );
}

#[test]
fn an_empty_file_lacks_its_header() {
    assert_eq!(
        message(&log(&[("imu.csv", "")])),
        "imu.csv:1: the file is empty; its first line must be `t,wx,wy,wz,fx,fy,fz`: no log is without an IMU, so the \
         recording was cut off or the file was overwritten"
    );
    let message = message(&log(&[("dvl.csv", "")]));
    assert!(message.starts_with("dvl.csv:1: the file is empty"), "{message}");
    assert!(message.ends_with("or delete the file: a missing file means that the sensor was not fitted"), "{message}");
}

#[test]
fn a_zero_length_log_is_refused_but_a_silent_sensor_is_not() {
    assert_eq!(
        message(&log(&[("imu.csv", "t,wx,wy,wz,fx,fy,fz\n")])),
        "imu.csv:2: no row follows the header; the log has zero length (record or export it again)"
    );
    let silent = log(&[("ps.csv", "t,depth\n")]);
    assert_eq!(LogDirectory::open(silent.path()).unwrap().merged().unwrap().count(), 2);
}

#[test]
fn a_missing_column_is_named_with_the_header_found() {
    assert_eq!(
        message(&log(&[("dvl.csv", "t,vx,vz\n0,1,2\n")])),
        "dvl.csv:1: column `vy` is missing; the header must hold `t,vx,vy,vz`, separated by commas, and reads `t,vx,vz`"
    );
    // Semicolons make one long name of the header.
    assert!(message(&log(&[("ps.csv", "t;depth\n0;1\n")])).starts_with("ps.csv:1: column `t` is missing"));
    assert!(message(&log(&[("truth.csv", "t,lat,lon\n")])).starts_with("truth.csv:1: column `h` is missing"));
}

#[test]
fn a_column_that_stands_twice_is_refused() {
    assert_eq!(
        message(&log(&[("ps.csv", "t,depth,depth\n0,1,2\n")])),
        "ps.csv:1: column `depth` stands twice in the header; rename or remove one"
    );
}

#[test]
fn text_in_a_number_is_shown_with_its_line_and_column() {
    assert_eq!(
        message(&log(&[("dvl.csv", "t,vx,vy,vz\n0,1,2,3\n1,1,fast,3\n")])),
        "dvl.csv:3: column `vy` holds \"fast\", which is not a number (write `nan` for not reported)"
    );
    assert_eq!(
        message(&log(&[("lbl.csv", "t,buoy,range\n0,B2,100\n")])),
        "lbl.csv:2: column `buoy` holds \"B2\", which is not a whole number"
    );
    assert_eq!(
        message(&log(&[("ps.csv", "t,depth\nnan,1\n")])),
        "ps.csv:2: column `t` holds \"nan\", which is not a time in decimal seconds"
    );
}

#[test]
fn a_decimal_comma_is_recognised() {
    assert_eq!(
        message(&log(&[("dvl.csv", "t,vx,vy,vz\n0,1,2,5,3\n")])),
        "dvl.csv:2: the row has 5 cells where the header has 4 columns, near column `vz` (is the comma used as a decimal \
         point? write `.`)"
    );
}

#[test]
fn a_truncated_last_line_is_an_error() {
    let expected = "imu.csv:4: the row has 3 cells where the header has 7 columns, near column `wz` (is the row cut off? \
                    write every cell, empty where not reported)";
    assert_eq!(message(&log(&[("imu.csv", &format!("{IMU}0.010,0,0"))])), expected);
    let cut_in_a_number = message(&log(&[("ps.csv", "t,depth\n0,1.5\n1,-")]));
    assert!(cut_in_a_number.starts_with("ps.csv:3: column `depth` holds \"-\""), "{cut_in_a_number}");
}

#[test]
fn time_running_backwards_names_both_times() {
    assert_eq!(
        message(&log(&[("imu.csv", "t,wx,wy,wz,fx,fy,fz\n1.5,0,0,0,0,0,9.8\n1.495,0,0,0,0,0,9.8\n")])),
        "imu.csv:3: column `t`: time runs backwards, 1.495 s after 1.5 s (sort the rows by `t`)"
    );
}

#[test]
fn equal_times_are_no_error() {
    let dir = log(&[("imu.csv", "t,wx,wy,wz,fx,fy,fz\n1,0,0,0,0,0,9.8\n1,0,0,0,0,0,9.8\n")]);
    assert_eq!(LogDirectory::open(dir.path()).unwrap().imu().unwrap().filter_map(Result::ok).count(), 2);
}

#[test]
fn a_buoy_without_position_names_the_range() {
    let buoys = "t,buoy,lat,lon,h\n0,1,36.1,127.3,0\n0,3,nan,nan,nan\n";
    let dir = log(&[("lbl.csv", "t,buoy,range\n0,1,100\n0,2,100\n"), ("buoys.csv", buoys)]);
    let error = LogDirectory::open(dir.path()).unwrap().check_buoys().unwrap_err();
    assert_eq!(
        plain(&dir, &error),
        "lbl.csv:3: column `buoy`: buoy 2 has no position (add its row to buoys.csv, or leave LBL out with `--no-lbl`)"
    );
    // A row that says nothing is no position.
    let dir = log(&[("lbl.csv", "t,buoy,range\n0,3,100\n"), ("buoys.csv", buoys)]);
    let error = LogDirectory::open(dir.path()).unwrap().check_buoys().unwrap_err();
    assert!(matches!(error, LogError::BuoyWithoutPosition { line: 2, buoy: 3, .. }), "{error}");
    // No `buoys.csv` at all.
    let dir = log(&[("lbl.csv", "t,buoy,range\n0,3,100\n")]);
    assert!(LogDirectory::open(dir.path()).unwrap().check_buoys().is_err());
}

#[test]
fn a_binary_file_is_not_read_into_memory_whole() {
    let dir = log(&[]);
    fs::write(dir.path().join("ps.csv"), vec![7_u8; 1 << 20]).unwrap();
    assert_eq!(message(&dir), "ps.csv:1: the line is longer than 65536 bytes; is this a CSV file?");
}

#[test]
fn nan_infinite_and_empty_cells_are_readings_for_the_preprocessor_to_count() {
    let dir = log(&[("gnss.csv", "t,lat,lon,h,se,sn,su\n0,36.1,127.3,nan,inf,,-inf\n")]);
    let fix = LogDirectory::open(dir.path()).unwrap().gnss().unwrap().next().unwrap().unwrap();
    assert!(fix.height.is_nan() && fix.sigma_enu[1].is_nan());
    assert_eq!((fix.sigma_enu[0], fix.sigma_enu[2]), (f64::INFINITY, f64::NEG_INFINITY));
}

#[test]
fn nothing_is_read_beyond_a_bad_row() {
    let dir = log(&[("ps.csv", "t,depth\n0,1\n1,x\n2,1\n")]);
    let rows: Vec<_> = LogDirectory::open(dir.path()).unwrap().ps().unwrap().collect();
    assert_eq!(rows.len(), 2);
    assert!(rows[0].is_ok() && rows[1].is_err());
    let merged: Vec<_> = LogDirectory::open(dir.path()).unwrap().merged().unwrap().collect();
    assert!(merged.last().unwrap().is_err() && merged.iter().filter(|row| row.is_err()).count() == 1);
}

#[test]
fn an_estimate_file_is_read_as_carefully() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("estimate.csv");
    let read = |text: &str| {
        fs::write(&file, text).unwrap();
        let error = read_estimates(&file).and_then(|rows| rows.collect::<Result<Vec<_>, _>>()).unwrap_err();
        plain(&dir, &error)
    };
    assert!(read("").starts_with("estimate.csv:1: the file is empty"));
    assert!(read("t,e,n\n").starts_with("estimate.csv:1: column `u` is missing"));
    let header = "t,e,n,u,qw,qx,qy,qz,ve,vn,vu,bax,bay,baz,bgx,bgy,bgz,se,sn,su,sroll,spitch,syaw,lat,lon,h";
    let zeros = ",0".repeat(24);
    assert!(read(&format!("{header}\n1,x{zeros}\n")).starts_with("estimate.csv:2: column `e` holds \"x\""));
    let backwards = read(&format!("{header}\n1,0{zeros}\n0.5,0{zeros}\n"));
    assert_eq!(backwards, "estimate.csv:3: column `t`: time runs backwards, 0.5 s after 1 s (sort the rows by `t`)");
    let missing = read_estimates(dir.path().join("none.csv")).unwrap_err();
    assert_eq!(plain(&dir, &missing), "none.csv: cannot open");
}
