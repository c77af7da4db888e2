//! What a log directory means: columns by name, epochs, moored buoys, the order of a merge.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::fs;

use ilns_recording::{LogDirectory, LogWriter, LogWriterOptions};
use shared_types::{Header, ImuSample, LblRange, PsDepth, RawReading, Sensor, Time};
use tempfile::TempDir;

const IMU: &str = "t,wx,wy,wz,fx,fy,fz\n";

fn log(files: &[(&str, &str)]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(dir.path().join(name), text).unwrap();
    }
    dir
}

fn merged(dir: &TempDir) -> Vec<RawReading> {
    LogDirectory::open(dir.path()).unwrap().merged().unwrap().collect::<Result<_, _>>().unwrap()
}

#[test]
fn columns_may_stand_in_any_order_among_others_with_windows_line_ends_and_a_byte_order_mark() {
    let text = "\u{feff}fz, wx ,wy,wz,note,fx,fy,t\r\n9.8,1,2,3,calm,4,5,-0.25\r\n9.7,1,2,3,,4,5,-0.245\r\n\r\n";
    let dir = log(&[("imu.csv", text)]);
    let samples: Vec<ImuSample> = LogDirectory::open(dir.path()).unwrap().imu().unwrap().map(Result::unwrap).collect();
    assert_eq!(samples.len(), 2);
    assert_eq!(samples[0].header, Header { sequence: 0, ..Header::at(Time(-250_000_000)) });
    assert_eq!(samples[1].header.sequence, 1);
    assert_eq!((samples[0].gyro_body, samples[0].accel_body), ([1.0, 2.0, 3.0], [4.0, 5.0, 9.8]));
    assert_eq!(samples[1].accel_body[2], 9.7);
}

#[test]
fn a_unix_epoch_keeps_its_nanoseconds_and_the_last_line_needs_no_end() {
    let dir = log(&[("imu.csv", &format!("{IMU}1746099142.369755001,0,0,0,0,0,9.8"))]);
    assert_eq!(merged(&dir)[0].t_valid(), Time(1_746_099_142_369_755_001));
}

#[test]
fn every_range_knows_how_many_its_epoch_has() {
    let lbl = "t,buoy,range\n1,1,100\n1,2,101\n1,3,102\n2,4,103\n3.0,1,104\n3,1,105\n";
    let dir = log(&[("imu.csv", &format!("{IMU}0,0,0,0,0,0,9.8\n")), ("lbl.csv", lbl)]);
    let ranges: Vec<LblRange> = LogDirectory::open(dir.path()).unwrap().lbl().unwrap().map(Result::unwrap).collect();
    let sizes: Vec<u32> = ranges.iter().map(|range| range.in_epoch).collect();
    assert_eq!(sizes, [3, 3, 3, 1, 2, 2]);
    assert_eq!(ranges.iter().map(|range| range.header.sequence).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
}

#[test]
fn an_epoch_before_a_bad_row_is_still_delivered() {
    let lbl = "t,buoy,range\n1,1,100\n1,2,101\n1,x,102\n";
    let dir = log(&[("imu.csv", &format!("{IMU}0,0,0,0,0,0,9.8\n")), ("lbl.csv", lbl)]);
    let ranges: Vec<_> = LogDirectory::open(dir.path()).unwrap().lbl().unwrap().collect();
    assert_eq!(ranges.iter().map(Result::is_ok).collect::<Vec<_>>(), [true, true, false]);
}

#[test]
fn a_buoy_of_one_row_is_moored_and_one_of_several_drifts() {
    let buoys = "t,buoy,lat,lon,h\n0,1,36.1,127.3,0\n0,2,36.2,127.3,0\n10,2.0,36.3,127.3,0\n";
    let dir = log(&[("imu.csv", &format!("{IMU}0,0,0,0,0,0,9.8\n")), ("buoys.csv", buoys)]);
    let fixes = LogDirectory::open(dir.path()).unwrap().buoy_fixes().unwrap();
    assert_eq!(fixes.iter().map(|fix| (fix.buoy, fix.moored)).collect::<Vec<_>>(), [(1, 1), (2, 0), (2, 0)]);
}

#[test]
fn sensors_of_equal_time_come_in_the_order_of_the_format() {
    let dir = log(&[
        ("imu.csv", &format!("{IMU}0,0,0,0,0,0,9.8\n1,0,0,0,0,0,9.8\n")),
        ("lbl.csv", "t,buoy,range\n1,1,100\n"),
        ("ps.csv", "t,depth\n1,2\n"),
        ("mcp.csv", "t,heading\n1,2\n"),
        ("dvl.csv", "t,vx,vy,vz\n1,0,0,0\n"),
        ("gnss.csv", "t,lat,lon,h,se,sn,su\n1,36,127,0,1,1,1\n"),
        ("buoys.csv", "t,buoy,lat,lon,h\n1,1,36,127,0\n"),
    ]);
    let order: Vec<Sensor> = merged(&dir).iter().map(RawReading::sensor).collect();
    let expected =
        [Sensor::Imu, Sensor::Imu, Sensor::Buoys, Sensor::Gnss, Sensor::Dvl, Sensor::Mcp, Sensor::Ps, Sensor::Lbl];
    assert_eq!(order, expected);
}

#[test]
fn a_log_is_merged_by_time_and_starts_with_whichever_sensor_is_first() {
    let dir = log(&[
        ("imu.csv", &format!("{IMU}0,0,0,0,0,0,9.8\n0.5,0,0,0,0,0,9.8\n1,0,0,0,0,0,9.8\n")),
        ("ps.csv", "t,depth\n-3,2\n0.4,2\n7,2\n"),
    ]);
    let times: Vec<i64> = merged(&dir).iter().map(|reading| reading.t_valid().0 / 100_000_000).collect();
    assert_eq!(times, [-30, 0, 4, 5, 10, 70]);
    assert!(!LogDirectory::open(dir.path()).unwrap().is_recording());
}

#[test]
fn a_recording_is_merged_by_arrival_and_may_hold_readings_that_came_late() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = LogWriter::create(dir.path(), LogWriterOptions { arrival_columns: true, replace: false }).unwrap();
    let header = |t: i64, t_arrival: i64| Header { t_arrival, ..Header::at(Time(t)) };
    for (t, arrival) in [(10, 110), (20, 120), (30, 130)] {
        let header = header(t, arrival);
        writer.imu(&ImuSample { header, gyro_body: [0.0; 3], accel_body: [0.0; 3] }).unwrap();
    }
    // Valid first, arrived last; and its own time runs backwards.
    writer.ps(&PsDepth { header: header(9, 125), depth: 1.0 }).unwrap();
    writer.ps(&PsDepth { header: header(5, 135), depth: 1.0 }).unwrap();
    writer.finish().unwrap();
    assert!(LogDirectory::open(dir.path()).unwrap().is_recording());
    let order: Vec<i64> = merged(&dir).iter().map(|reading| reading.header().t_arrival).collect();
    assert_eq!(order, [110, 120, 125, 130, 135]);

    // One file without arrivals, and the whole folder goes by `t`.
    fs::write(dir.path().join("ps.csv"), "t,depth\n0,1\n").unwrap();
    let log = LogDirectory::open(dir.path()).unwrap();
    assert!(!log.is_recording() && !log.merged().unwrap().is_recording());
}

#[test]
fn sensors_toml_is_handed_on_as_text() {
    let dir = log(&[("imu.csv", &format!("{IMU}0,0,0,0,0,0,9.8\n")), ("sensors.toml", "[lbl]\nsigma = 0.3\n")]);
    let log = LogDirectory::open(dir.path()).unwrap();
    assert_eq!(log.config().unwrap().text, "[lbl]\nsigma = 0.3\n");
    assert_eq!(log.config().unwrap().file, dir.path().join("sensors.toml"));
    assert!(log.has(Sensor::Imu) && !log.has(Sensor::Dvl) && !log.has_truth());
}

#[test]
fn a_log_is_not_written_into_another() {
    let dir = log(&[("ps.csv", "t,depth\n0,1\n")]);
    let error = LogWriter::create(dir.path(), LogWriterOptions::default()).unwrap_err().to_string();
    assert!(error.contains("ps.csv exists"), "{error}");
    LogWriter::create(dir.path(), LogWriterOptions { replace: true, ..LogWriterOptions::default() }).unwrap();
    assert!(!dir.path().join("ps.csv").exists());
}
