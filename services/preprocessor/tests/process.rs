//! The preprocessor as a process on a bus of its own: what goes in, what comes out, what a restart remembers.
#![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]

use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ilns_bus::{Bus, Owner, Prefix, Subscriber};
use ilns_preprocessor::{Args, PreprocessorError, run_until};
use ilns_runtime::{ProcessArgs, Shutdown};
use shared_types::{
    BuoyFix, GnssFix, Header, ImuSample, LblRange, Measurement, Message, Process, ProcessState, Reading, Sensor, Time,
    channel,
};

/// The part of `ilns preprocessor`, in a thread.
struct Preprocessor {
    shutdown: Shutdown,
    thread: JoinHandle<Result<(), PreprocessorError>>,
}

impl Preprocessor {
    fn start(prefix: &Prefix, epoch: u32, sets: &[&str]) -> Preprocessor {
        let args = Args {
            process: ProcessArgs {
                prefix: prefix.name().to_owned(),
                sets: sets.iter().map(|&set| set.to_owned()).collect(),
                epoch,
                log_level: "warn".to_owned(),
                ..ProcessArgs::default()
            },
            keep: None,
        };
        let shutdown = Shutdown::default();
        let stop = shutdown.clone();
        Preprocessor { shutdown, thread: std::thread::spawn(move || run_until(&args, &stop)) }
    }

    fn stop(self) {
        self.shutdown.request();
        self.thread.join().unwrap().unwrap();
    }
}

/// A prefix that no other test has.
fn prefix(test: &str) -> Prefix {
    Prefix::new(&format!("p{}-{test}", std::process::id())).unwrap()
}

fn header(t: f64) -> Header {
    Header::at(Time::from_seconds(t))
}

fn imu(t: f64) -> ImuSample {
    ImuSample { header: header(t), gyro_body: [0.0; 3], accel_body: [0.0, 0.0, 9.8] }
}

fn gnss(t: f64, lat_deg: f64) -> GnssFix {
    GnssFix { header: header(t), lat_deg, lon_deg: 127.0, height: f64::NAN, sigma_enu: [1.0; 3] }
}

/// Receives until `wanted` says that it has come.
fn await_message<T: Message>(what: &str, subscriber: &mut Subscriber<T>, mut wanted: impl FnMut(&T) -> bool) -> Vec<T> {
    let deadline = Instant::now() + Duration::from_secs(10);
    let mut all = Vec::new();
    loop {
        while let Some(message) = subscriber.receive() {
            all.push(message);
            if wanted(&message) {
                return all;
            }
        }
        assert!(Instant::now() < deadline, "{what} did not come within 10 s");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn is_keyframe(measurement: &Measurement) -> bool {
    measurement.kind == Measurement::KEYFRAME
}

/// The process hears only what is sent after it has joined, which its first heartbeat says.
fn await_running(bus: &Bus) {
    let mut health = bus.subscriber(&channel::HEALTH).unwrap();
    await_message("the first heartbeat", &mut health, |beat| {
        beat.process == Process::Preprocessor as u32 && beat.state == ProcessState::Running as u32
    });
}

#[test]
fn readings_of_all_channels_come_out_as_one_anchored_stream() {
    let prefix = prefix("stream");
    let _owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::EmulatorImu, 0).unwrap();
    let mut measurements = bus.subscriber(&channel::MEASUREMENTS).unwrap();
    let mut origins = bus.subscriber(&channel::FRAME_ORIGIN).unwrap();
    let sets = ["frame.origin=[36.0, 127.0, 0.0]", "initial.quaternion=[1.0, 0.0, 0.0, 0.0]"];
    let process = Preprocessor::start(&prefix, 0, &sets);
    await_running(&bus);

    let mut buoys = bus.publisher(&channel::BUOYS).unwrap();
    let mut lbl = bus.publisher(&channel::LBL).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    buoys.publish(BuoyFix { header: header(0.0), buoy: 3, moored: 1, lat_deg: 36.0, lon_deg: 127.0, height: 0.0 });
    lbl.publish(LblRange { header: header(1.0), buoy: 3, in_epoch: 1, range: 40.0 });
    lbl.publish(LblRange { header: header(1.0), buoy: 4, in_epoch: 1, range: 40.0 });
    for step in 0..=110 {
        samples.publish(imu(f64::from(step) * 0.01));
    }

    let mut keyframes = 0;
    let all = await_message("the keyframe of the ping", &mut measurements, |measurement| {
        keyframes += usize::from(is_keyframe(measurement));
        keyframes == 2
    });
    let aided: Vec<_> = all.iter().filter(|m| m.sensor() != Some(Sensor::Imu)).map(Reading::try_from).collect();
    assert_eq!(aided.len(), 3, "start, range, keyframe: {aided:?}");
    assert!(matches!(aided[1], Ok(Reading::Lbl { buoy: 3, range: 40.0, .. })), "{aided:?}");
    let latched = await_message("the origin", &mut origins, |_| true);
    assert_eq!((latched[0].lat_deg, latched[0].lon_deg), (36.0, 127.0));

    let mut health = bus.subscriber(&channel::HEALTH).unwrap();
    let beats = await_message("a heartbeat with all samples", &mut health, |beat| beat.sensors[0].received == 111);
    let ranges = &beats.last().unwrap().sensors[Sensor::Lbl.index()];
    assert_eq!((ranges.received, ranges.rejected.iter().sum::<u64>(), ranges.lost), (2, 1, 0));
    process.stop();
}

#[test]
fn a_restart_keeps_the_frame_where_it_was() {
    let prefix = prefix("restart");
    let owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::EmulatorGnss, 0).unwrap();
    let mut origins = bus.subscriber(&channel::FRAME_ORIGIN).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    let mut fixes = bus.publisher(&channel::GNSS).unwrap();

    let first = Preprocessor::start(&prefix, 0, &[]);
    await_running(&bus);
    samples.publish(imu(0.0));
    fixes.publish(gnss(0.1, 36.5));
    for step in 1..=60 {
        samples.publish(imu(f64::from(step) * 0.01));
    }
    assert_eq!(await_message("the origin", &mut origins, |_| true)[0].lat_deg, 36.5);
    first.stop();
    owner.cleanup_dead_nodes();

    let second = Preprocessor::start(&prefix, 1, &[]);
    let again = await_message("the origin of the restarted process", &mut origins, |origin| origin.header.epoch == 1);
    assert_eq!(again.last().unwrap().lat_deg, 36.5);
    let mut measurements = bus.subscriber(&channel::MEASUREMENTS).unwrap();
    fixes.publish(gnss(0.8, 36.6));
    for step in 61..=300 {
        samples.publish(imu(f64::from(step) * 0.01));
    }
    let all = await_message("the fix", &mut measurements, |m| m.sensor() == Some(Sensor::Gnss));
    let Ok(Reading::Gnss { antenna_enu, .. }) = Reading::try_from(all.last().unwrap()) else { panic!("{all:?}") };
    // A tenth of a degree of the meridian, from the first fix.
    assert!((antenna_enu[1] - 11_096.0).abs() < 10.0, "{antenna_enu:?}");
    second.stop();
}

#[test]
fn without_an_owner_it_says_how_to_start_one() {
    let prefix = prefix("alone");
    let process = Preprocessor::start(&prefix, 0, &[]);
    let message = process.thread.join().unwrap().unwrap_err().to_string();
    assert!(message.contains("ilns run"), "{message}");
}
