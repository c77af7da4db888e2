//! Public data sets as log directories: folders of the exact format, made here from a known drive, whole and damaged.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::f64::consts::PI;
use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

use clap::Parser;
use ilns_recording::{LogDirectory, Summary};
use ilns_replay::{ConvertArgs, ReplayArgs, convert, replay};
use nalgebra::{UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, LocalFrame, UtmZone};
use tempfile::TempDir;

const EPOCH: i64 = 1_559_193_232_000_000_000;
const ZONE: UtmZone = UtmZone { number: 52, is_north: true };
const SPEED: f64 = 10.0;
const RADIUS: f64 = 80.0;
const SECONDS: i64 = 60;
/// Of the rear axle's middle, in the middle of the circle, UTM.
const CENTRE: [f64; 3] = [353_000.0, 4_026_000.0, 41.0];
const IMU_ARM: [f64; 3] = [-0.07, 0.0, 1.7];
const VRS_ARM: [f64; 3] = [-0.3, 0.2, 2.0];
const WHEEL: f64 = 0.623;
/// Geoid, calibration of the map: heights of the pose file are lower by that.
const DATUM: f64 = 25.5;

#[derive(Parser)]
struct Convert {
    #[command(flatten)]
    args: ConvertArgs,
}

#[derive(Parser)]
struct Replay {
    #[command(flatten)]
    args: ReplayArgs,
}

/// Rear axle and heading (from grid east, counterclockwise) at a time in s: round and round to the left, at constant speed.
fn vehicle(t: f64) -> ([f64; 2], f64) {
    let phase = SPEED / RADIUS * t;
    ([CENTRE[0] + RADIUS * phase.sin(), CENTRE[1] - RADIUS * phase.cos()], phase)
}

/// A point of the vehicle in UTM.
fn point(t: f64, arm: [f64; 3]) -> [f64; 3] {
    let ([x, y], yaw) = vehicle(t);
    let (sin, cos) = yaw.sin_cos();
    [x + cos * arm[0] - sin * arm[1], y + sin * arm[0] + cos * arm[1], CENTRE[2] + arm[2]]
}

/// Rate and specific force of the IMU. A constant turn: the centre pulls, at the IMU a little less or more.
fn inertial() -> ([f64; 3], [f64; 3]) {
    let rate = SPEED / RADIUS;
    ([0.0, 0.0, rate], [-rate * rate * IMU_ARM[0], SPEED * rate - rate * rate * IMU_ARM[1], 9.798])
}

fn stamp(t: f64) -> i64 {
    EPOCH + (t * 1e9).round() as i64
}

struct Folder(TempDir);

impl Folder {
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        let file = self.path(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, text).unwrap();
    }

    fn rewrite(&self, name: &str, change: impl FnOnce(Vec<&str>) -> Vec<String>) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        self.write(name, &(change(text.lines().collect()).join("\n") + "\n"));
    }

    fn convert(&self, format: &str) -> Result<(), String> {
        let (dir, out) = (self.path("in"), self.path("log"));
        let args = ["convert", format, dir.to_str().unwrap(), "--out", out.to_str().unwrap(), "--replace"];
        convert::run(&Convert::parse_from(args).args).map_err(|error| {
            let message = error.to_string();
            assert_eq!(message.lines().count(), 1, "{message}");
            message.replace(self.0.path().to_str().unwrap(), "")
        })
    }

    fn notes(&self) -> String {
        fs::read_to_string(self.path("log/sensors.toml")).unwrap()
    }

    fn replay(&self) -> Summary {
        let (log, out) = (self.path("log"), self.path("out"));
        let args = ["replay", log.to_str().unwrap(), "--out", out.to_str().unwrap()];
        replay::run(&Replay::parse_from(args).args).unwrap();
        Summary::read(out.join("summary.json")).unwrap()
    }
}

fn rows(rate: i64, row: impl Fn(f64) -> String) -> String {
    (0..SECONDS * rate).map(|index| row(index as f64 / rate as f64) + "\n").collect()
}

/// A minute of a sequence. Fixes float from 20 s, are single from 30 s and lost from 35 s to 40 s.
fn kaist() -> Folder {
    let folder = Folder(tempfile::tempdir().unwrap());
    let ([gx, gy, gz], [ax, ay, az]) = inertial();
    let imu = |t: f64| format!("{},0,0,0,1,0,0,0,{gx},{gy},{gz},{ax},{ay},{az},0.1,0.2,0.3", stamp(t));
    folder.write("in/sensor_data/xsens_imu.csv", &rows(100, imu));
    let place = |t: f64| {
        let [x, y, z] = point(t, VRS_ARM);
        (ZONE.to_geodetic(x, y, z + DATUM).to_degrees(), x, y)
    };
    let vrs = |t: f64| {
        let ([lat, lon, h], x, y) = place(t);
        let (state, std) = match t as i64 {
            20..30 => (5, 0.4),
            30..35 => (1, 2.0),
            35..40 => (0, 9.0),
            _ => (4, 0.01),
        };
        format!(
            "{},{lat:.9},{lon:.9},{x},{y},{h},{state},12,0.8,{std},{std},{std},0,0.0,19.4,36.0,D,{}",
            stamp(t),
            h - 27.0
        )
    };
    folder.write("in/sensor_data/vrs_gps.csv", &rows(1, vrs));
    let gps = |t: f64| {
        let ([lat, lon, h], _, _) = place(t);
        format!("{},{lat:.9},{lon:.9},{h},4.0,0,0,0,4.0,0,0,0,9.0", stamp(t))
    };
    folder.write("in/sensor_data/gps.csv", &rows(1, gps));
    // The left wheel runs on a smaller circle.
    let counts =
        |t: f64, side: f64| ((SPEED + side * SPEED / RADIUS * 0.76) * t / (PI * WHEEL) * 4096.0).floor() as i64;
    folder.write(
        "in/sensor_data/encoder.csv",
        &rows(100, |t| format!("{},{},{}", stamp(t), 7_000 + counts(t, -1.0), 9_000 + counts(t, 1.0))),
    );
    folder.write("in/sensor_data/altimeter.csv", &rows(10, |t| format!("{},{}", stamp(t), 12.3)));
    let pose = |t: f64| {
        let ([x, y], yaw) = vehicle(t);
        let (sin, cos) = yaw.sin_cos();
        format!("{},{cos},{},0,{x},{sin},{cos},0,{y},0,0,1,{}", stamp(t), -sin, CENTRE[2])
    };
    folder.write("in/global_pose.csv", &rows(20, pose));
    let mounting = |arm: [f64; 3]| format!("R: 1 0 0 0 1 0 0 0 1\nT: {} {} {}\n", arm[0], arm[1], arm[2]);
    folder.write("in/calibration/Vehicle2IMU.txt", &mounting(IMU_ARM));
    folder.write("in/calibration/Vehicle2VRS.txt", &mounting(VRS_ARM));
    folder.write(
        "in/calibration/EncoderParameter.txt",
        &format!("Encoder calibrated parameter\n\nEncoder resolution: 4096\nEncoder left wheel diameter: {WHEEL}\nEncoder right wheel diameter: {WHEEL}\nEncoder wheel base: 1.52\n"),
    );
    folder
}

#[test]
fn a_kaist_sequence_becomes_a_log_that_navigates_to_its_truth() {
    let folder = kaist();
    folder.convert("kaist").unwrap();
    let log = LogDirectory::open(folder.path("log")).unwrap();
    let truth: Vec<_> = log.truth().unwrap().map(Result::unwrap).collect();
    assert_eq!(truth.len() as i64, 10 * SECONDS, "20 Hz thinned to 10");
    // Heights in the datum of the receiver, at the IMU.
    assert!((truth[0].height - (CENTRE[2] + DATUM + IMU_ARM[2])).abs() < 1e-6, "{}", truth[0].height);
    // Grid east is not east: 126.8 degrees of longitude lie west of the meridian, grid north points west of north there.
    let q = truth[0].q_enu_body;
    let yaw = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3])).euler_angles().2;
    let longitude = truth[0].lon_deg.to_radians() - 129_f64.to_radians();
    let convergence = (longitude.tan() * truth[0].lat_deg.to_radians().sin()).atan();
    assert!(convergence < -0.015 && (yaw + convergence).abs() < 1e-4, "{yaw} {convergence}");
    // All ranges while fixed, none while lost, some in between.
    let seconds: Vec<i64> =
        log.lbl().unwrap().map(|range| (range.unwrap().header.t_valid - EPOCH) / 1_000_000_000).collect();
    let in_span = |from: i64, to: i64| seconds.iter().filter(|s| (from..to).contains(*s)).count();
    assert_eq!((in_span(0, 20), in_span(35, 40)), (80, 0));
    assert!((15..40).contains(&in_span(20, 30)) && (1..16).contains(&in_span(30, 35)), "{}", in_span(20, 30));
    let speeds: Vec<f64> = log.dvl().unwrap().map(|row| row.unwrap().velocity_dvl[0]).collect();
    assert!(speeds.len() > 550 && speeds.iter().all(|speed| (speed - SPEED).abs() < 0.01), "{:?}", &speeds[..3]);
    let depths: Vec<f64> = log.ps().unwrap().map(|row| row.unwrap().depth).collect();
    assert!(depths.iter().all(|depth| depth.abs() < 1e-6), "the antenna's height is the surface: {:?}", &depths[..3]);
    let score = folder.replay().score.unwrap();
    let (rms, up) = (score["rms_horizontal"].as_f64().unwrap(), score["rms_enu"][2].as_f64().unwrap());
    // Ranges of 0.3 m give 0.2 m; for a quarter of the time they are five times worse than the estimator is told.
    assert!(rms < 0.6 && up < 2.5, "{rms} {up}");
    assert!(score["attitude_rms_deg"][2].as_f64().unwrap() < 1.5, "{score}");
}

#[test]
fn an_old_sequence_a_missing_file_and_a_cut_row_get_one_line_each() {
    let folder = kaist();
    let refused = |name: &str, text: &str| {
        let kept = fs::read(folder.path(name)).unwrap();
        if text.is_empty() {
            fs::remove_file(folder.path(name)).unwrap()
        } else {
            folder.write(name, text)
        }
        let message = folder.convert("kaist").unwrap_err();
        fs::write(folder.path(name), kept).unwrap();
        message
    };
    let imu = "in/sensor_data/xsens_imu.csv";
    let old = refused(imu, "1559193232000000000,0,0,0,1,0.1,0.2,0.3\n");
    assert!(old.contains("xsens_imu.csv:1: the row has 8 values where the format has 17 (an older sequence"), "{old}");
    assert!(refused(imu, "").contains("xsens_imu.csv: cannot open"));
    assert!(refused(imu, "\n\n").contains("no row in the file"));
    let text = fs::read_to_string(folder.path(imu)).unwrap();
    let cut = refused(imu, &text[..text.len() - 30]);
    assert!(cut.contains(":6000: the row has 12 values") && cut.contains("cut off?"), "{cut}");
    let word = refused("in/sensor_data/encoder.csv", "1559193232000000000,12,many\n");
    assert!(word.contains("encoder.csv:1: column `right_count` holds \"many\""), "{word}");
    assert!(refused("in/sensor_data/vrs_gps.csv", "").contains("vrs_gps.csv: cannot open"));
    let unfixed = refused("in/sensor_data/vrs_gps.csv", "1559193232000000000,36,127,0,0,40,1,12,0.8,1,1,1,0,0,1,1,D\n");
    assert!(unfixed.contains("no fixed position (fix state 4)"), "{unfixed}");
    let calibration = refused("in/calibration/EncoderParameter.txt", "Encoder resolution: 4096\n");
    assert!(calibration.contains("no line `Encoder left wheel diameter:`"), "{calibration}");
    let mounting = refused("in/calibration/Vehicle2IMU.txt", "R: 1 0 0 0 1 0 0 0\nT: 0 0 0\n");
    assert!(mounting.contains("Vehicle2IMU.txt: there is no line `R: r11 r12 ... r33`"), "{mounting}");
}

#[test]
fn what_is_left_out_of_a_sequence_or_stands_in_for_something_else_is_said() {
    let folder = kaist();
    for name in [
        "calibration/Vehicle2IMU.txt",
        "calibration/EncoderParameter.txt",
        "sensor_data/altimeter.csv",
        "global_pose.csv",
    ] {
        fs::remove_file(folder.path("in").join(name)).unwrap();
    }
    // Two rows change places, and the positions end early.
    folder.rewrite("in/sensor_data/xsens_imu.csv", |mut lines| {
        lines.swap(10, 11);
        lines.into_iter().map(str::to_owned).collect()
    });
    folder.rewrite("in/sensor_data/vrs_gps.csv", |lines| lines[..40].iter().map(ToString::to_string).collect());
    folder.convert("kaist").unwrap();
    let notes = folder.notes();
    for said in [
        "Vehicle2IMU.txt is missing: the sensor is taken to sit at the vehicle's origin",
        "EncoderParameter.txt is missing: no dvl.csv",
        "altimeter.csv is missing: no ps.csv",
        "global_pose.csv is missing: truth.csv is the fixed positions",
        "xsens_imu.csv: 1 rows stood after a later one and were sorted",
        "vrs_gps.csv ends 21.0 s before xsens_imu.csv",
    ] {
        assert!(notes.contains(said), "{said}\n{notes}");
    }
    assert!(!folder.path("log/dvl.csv").exists() && !folder.path("log/ps.csv").exists());
    assert!(!notes.contains("[initial]"), "the first state is found from the data");
    let log = LogDirectory::open(folder.path("log")).unwrap();
    assert_eq!(log.truth().unwrap().count(), 20, "positions that were fixed");
}

/// Twenty seconds of a drive on the same circle, around a place in Karlsruhe.
fn kitti(rate: i64) -> Folder {
    let folder = Folder(tempfile::tempdir().unwrap());
    let frame = LocalFrame::new(Geodetic::from_degrees(49.0, 8.4, 112.0));
    let ([wx, wy, wz], [ax, ay, az]) = ([0.0, 0.0, SPEED / RADIUS], [0.0, SPEED * SPEED / RADIUS, 9.809]);
    let mut stamps = String::new();
    for index in 0..20 * rate {
        let t = index as f64 / rate as f64;
        let phase = SPEED / RADIUS * t;
        let position_enu = Vector3::new(RADIUS * phase.sin(), -RADIUS * phase.cos(), 1.0);
        let [lat, lon, h] = frame.to_geodetic(&position_enu).to_degrees();
        let (ve, vn) = (SPEED * phase.cos(), SPEED * phase.sin());
        let yaw = (phase + PI).rem_euclid(2.0 * PI) - PI;
        let values = format!(
            "{lat:.12} {lon:.12} {h} 0 0 {yaw} {vn} {ve} {SPEED} 0 0 {ax} {ay} {az} {ax} {ay} {az} {wx} {wy} {wz} {wx} {wy} {wz} 0.05 0.02 4 10 4 4 0"
        );
        folder.write(&format!("in/oxts/data/{index:010}.txt"), &values);
        writeln!(stamps, "2011-10-03 12:55:{:012.9}", 34.0 + t).unwrap();
    }
    folder.write("in/oxts/timestamps.txt", &stamps);
    folder
}

#[test]
fn a_kitti_drive_becomes_a_log_that_navigates_to_its_truth() {
    let folder = kitti(100);
    folder.convert("kitti").unwrap();
    let log = LogDirectory::open(folder.path("log")).unwrap();
    let dvl: Vec<[f64; 3]> = log.dvl().unwrap().map(|row| row.unwrap().velocity_dvl).collect();
    assert_eq!(dvl.len(), 100);
    assert!(dvl.iter().all(|v| (v[0] - SPEED).abs() < 0.3 && v[1].abs() < 0.3 && v[2].abs() < 0.3), "{:?}", dvl[0]);
    assert_eq!(log.gnss().unwrap().count(), 20);
    let score = folder.replay().score.unwrap();
    assert!(score["rms_3d"].as_f64().unwrap() < 0.15, "{score}");
    assert!(score["attitude_rms_deg"][2].as_f64().unwrap() < 0.5, "{score}");
}

#[test]
fn a_slow_or_damaged_drive_is_refused_in_one_line() {
    let slow = kitti(10).convert("kitti").unwrap_err();
    assert!(slow.contains("a sample every 0.1 s is no inertial navigation (take the `_extract`"), "{slow}");
    let folder = kitti(100);
    folder.write("in/oxts/data/0000000007.txt", "49.0 8.4 1.0");
    let cut = folder.convert("kitti").unwrap_err();
    assert!(cut.contains("0000000007.txt:1: the row has 3 values where the format has 30"), "{cut}");
    fs::remove_file(folder.path("in/oxts/data/0000000007.txt")).unwrap();
    let counts = folder.convert("kitti").unwrap_err();
    assert!(counts.contains("2000 stamps in `timestamps.txt` but 1999 files"), "{counts}");
    folder.rewrite("in/oxts/timestamps.txt", |mut lines| {
        lines[3] = "noon";
        lines.into_iter().map(str::to_owned).collect()
    });
    assert!(folder.convert("kitti").unwrap_err().contains("timestamps.txt:4: column `stamp` holds \"noon\""));
    let nowhere = Folder(tempfile::tempdir().unwrap()).convert("kitti").unwrap_err();
    assert!(nowhere.contains("no `timestamps.txt` beside a folder `data`"), "{nowhere}");
}

#[test]
fn a_folder_that_holds_a_log_is_not_overwritten_unasked() {
    let folder = kaist();
    folder.convert("kaist").unwrap();
    let (dir, out) = (folder.path("in"), folder.path("log"));
    let args = ["convert", "kaist", dir.to_str().unwrap(), "--out", out.to_str().unwrap()];
    let message = convert::run(&Convert::parse_from(args).args).unwrap_err().to_string();
    assert!(message.contains("already holds a log"), "{message}");
}
