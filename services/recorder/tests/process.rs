//! The recorder as a process on a bus of its own: what was sent can be read back from the folder.
#![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]

use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ilns_bus::{Bus, Owner, Prefix};
use ilns_recorder::{Args, McapArgs, RecorderError, run_until};
use ilns_recording::{LogDirectory, Summary, read_estimates};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Shutdown};
use shared_types::{
    FrameOrigin, Header, ImuSample, LblRange, Mode, NavEstimate, Process, ProcessState, RejectReason, Sensor, Time,
    Truth, channel,
};

/// The part of `ilns recorder`, in a thread.
struct Recorder {
    shutdown: Shutdown,
    thread: JoinHandle<Result<(), RecorderError>>,
}

impl Recorder {
    fn start(prefix: &Prefix, epoch: u32, out: &Path) -> Recorder {
        let args = Args {
            process: ProcessArgs {
                prefix: prefix.name().to_owned(),
                sets: vec!["fgo.window=33".to_owned()],
                epoch,
                log_level: "error".to_owned(),
                ..ProcessArgs::default()
            },
            out: out.to_owned(),
            replace: false,
            mcap: McapArgs::default(),
        };
        let shutdown = Shutdown::default();
        let stop = shutdown.clone();
        Recorder { shutdown, thread: std::thread::spawn(move || run_until(&args, &stop)) }
    }

    /// What is sent from now on is recorded.
    fn await_running(&self, bus: &Bus) {
        let deadline = Instant::now() + Duration::from_secs(10);
        let mut health = bus.subscriber(&channel::HEALTH).unwrap();
        while health.newest().is_none_or(|beat| beat.state != ProcessState::Running as u32) {
            assert!(Instant::now() < deadline, "no heartbeat within 10 s");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn stop(self) -> Result<(), RecorderError> {
        self.shutdown.request();
        self.thread.join().unwrap()
    }
}

/// A prefix that no other test has.
fn prefix(test: &str) -> Prefix {
    Prefix::new(&format!("r{}-{test}", std::process::id())).unwrap()
}

fn header(t: f64) -> Header {
    Header { t_arrival: 1_000, origin_t_arrival: 1_000, ..Header::at(Time::from_seconds(t)) }
}

fn imu(t: f64) -> ImuSample {
    ImuSample { header: header(t), gyro_body: [0.1 / 3.0, 0.0, -1e-9], accel_body: [0.0, 0.0, 9.8] }
}

fn estimate(t: f64) -> NavEstimate {
    let unit_cov = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
    NavEstimate {
        header: header(t),
        solution: 5,
        t_keyframe: 0,
        position_enu: [1.0, 2.0, 3.0],
        velocity_enu: [0.0; 3],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: unit_cov,
        velocity_cov: unit_cov,
        attitude_cov: unit_cov,
        sigma_rpy: [1.0; 3],
        lat_lon_h: [36.0, 127.0, 0.0],
        aiding_age: [f64::INFINITY; 5],
        mode: Mode::Ok as u32,
        reserved: 0,
    }
}

#[test]
fn what_was_sent_stands_in_the_folder_to_the_bit() {
    let prefix = prefix("bits");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let _owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::EmulatorImu, 0).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    let mut ranges = bus.publisher(&channel::LBL).unwrap();
    let mut truths = bus.publisher(&channel::TRUTH).unwrap();
    let mut estimates = bus.publisher(&channel::ESTIMATE).unwrap();
    let mut origins = bus.publisher(&channel::FRAME_ORIGIN).unwrap();
    let mut health = bus.publisher(&channel::HEALTH).unwrap();
    let recorder = Recorder::start(&prefix, 0, &out);
    recorder.await_running(&bus);

    let times: Vec<f64> = (0..400).map(|step| f64::from(step) * 0.005).collect();
    origins.publish(FrameOrigin { header: header(0.0), lat_deg: 36.0, lon_deg: 127.0, height: 0.0 });
    ranges.publish(LblRange { header: header(1.0), buoy: 3, in_epoch: 1, range: 612.0 / 7.0 });
    truths.publish(Truth {
        header: header(0.5),
        lat_deg: 36.0,
        lon_deg: 127.0,
        height: 0.0,
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        velocity_enu: [0.0; 3],
    });
    for &t in &times {
        samples.publish(imu(t));
        estimates.publish(estimate(t));
    }
    let mut preprocessor = HeartbeatBuilder::new(Process::Preprocessor, 0);
    preprocessor.sensors[Sensor::Lbl.index()].received = 9;
    preprocessor.sensors[Sensor::Lbl.index()].rejected[RejectReason::UnknownBuoy.index()] = 4;
    health.publish(preprocessor.build());
    recorder.stop().unwrap();

    let log = LogDirectory::open(&out).unwrap();
    assert!(log.is_recording());
    let read: Vec<_> = log.imu().unwrap().map(Result::unwrap).collect();
    assert_eq!(read.len(), times.len());
    for (index, (sample, &t)) in read.iter().zip(&times).enumerate() {
        assert_eq!((sample.gyro_body, sample.accel_body), (imu(t).gyro_body, imu(t).accel_body));
        assert_eq!((sample.header.t_valid, sample.header.t_arrival), (header(t).t_valid, 1_000));
        assert_eq!(sample.header.sequence, index as u64);
    }
    let range = log.lbl().unwrap().next().unwrap().unwrap();
    assert_eq!((range.buoy, range.range), (3, 612.0 / 7.0));
    assert!(log.has_truth());
    assert!(log.config().unwrap().text.contains("window = 33"));

    let rows: Vec<_> = read_estimates(out.join("estimate.csv")).unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len(), times.len());
    assert_eq!((rows[7].t, rows[7].solution), (Time::from_seconds(times[7]), Some(5)));
    let summary = Summary::read(out.join("summary.json")).unwrap();
    assert_eq!((summary.estimates, summary.window), (400, 33));
    assert_eq!(summary.origin, [36.0, 127.0, 0.0]);
    let score = summary.score.unwrap();
    assert_eq!((score["samples"].as_u64(), score["rms_enu"][1].as_f64()), (Some(1), Some(2.0)));
    assert_eq!(summary.sensors["lbl"].received, 9);
    assert_eq!(summary.sensors["lbl"].rejected["unknown_buoy"], 4);
}

#[test]
fn a_restarted_recorder_leaves_the_first_record_alone() {
    let prefix = prefix("again");
    let folder = tempfile::tempdir().unwrap();
    let _owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::EmulatorImu, 0).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    for epoch in [0, 1] {
        let recorder = Recorder::start(&prefix, epoch, folder.path());
        recorder.await_running(&bus);
        samples.publish(imu(f64::from(epoch)));
        recorder.stop().unwrap();
    }
    let count = |path: &Path| LogDirectory::open(path).unwrap().imu().unwrap().count();
    assert_eq!(count(folder.path()), 1);
    assert_eq!(count(&folder.path().join("restart-1")), 2, "its own sample and the history of the bus");
}

#[test]
fn a_folder_that_holds_a_log_is_not_overwritten_unasked() {
    let prefix = prefix("full");
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("imu.csv"), "precious").unwrap();
    let _owner = Owner::take(&prefix).unwrap();
    let message = Recorder::start(&prefix, 0, folder.path()).stop().unwrap_err().to_string();
    assert!(message.contains("imu.csv"), "{message}");
    assert_eq!(std::fs::read_to_string(folder.path().join("imu.csv")).unwrap(), "precious");
}
