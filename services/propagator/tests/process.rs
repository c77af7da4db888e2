//! The propagator as a process on a bus of its own: samples and solutions in, estimates out.
#![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]

use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ilns_bus::{Bus, Owner, Prefix, Publisher, Subscriber};
use ilns_propagator::{Args, PropagatorError, run_until};
use ilns_runtime::{ProcessArgs, Shutdown, monotonic_now};
use shared_types::{
    Header, ImuSample, Message, Mode, NavEstimate, Process, ProcessState, RejectReason, Solution, Time, channel,
};

/// The part of `ilns propagator`, in a thread.
struct Propagator {
    shutdown: Shutdown,
    thread: JoinHandle<Result<(), PropagatorError>>,
}

impl Propagator {
    fn start(prefix: &Prefix, epoch: u32) -> Propagator {
        let args = Args {
            process: ProcessArgs {
                prefix: prefix.name().to_owned(),
                sets: vec!["frame.origin=[36.0, 127.0, 0.0]".to_owned()],
                epoch,
                log_level: "warn".to_owned(),
                ..ProcessArgs::default()
            },
        };
        let shutdown = Shutdown::default();
        let stop = shutdown.clone();
        Propagator { shutdown, thread: std::thread::spawn(move || run_until(&args, &stop)) }
    }

    fn stop(self) {
        self.shutdown.request();
        self.thread.join().unwrap().unwrap();
    }
}

/// A prefix that no other test has.
fn prefix(test: &str) -> Prefix {
    Prefix::new(&format!("q{}-{test}", std::process::id())).unwrap()
}

/// At rest, level, facing east.
fn imu(t: f64) -> ImuSample {
    let header = Header { t_arrival: monotonic_now(), ..Header::at(Time::from_seconds(t)) };
    ImuSample { header, gyro_body: [0.0, 0.0, 0.0], accel_body: [0.0, 0.0, 9.798] }
}

/// At rest at (3, 4, -5) m, from an LBL epoch at its keyframe.
fn solution(id: u64, t: f64) -> Solution {
    let mut covariance = [[0.0; 15]; 15];
    for (index, row) in covariance.iter_mut().enumerate() {
        row[index] = 1e-6;
    }
    let t = Time::from_seconds(t);
    Solution {
        header: Header::at(t),
        id,
        t_keyframe: t.0,
        origin: [36.0, 127.0, 0.0],
        position_enu: [3.0, 4.0, -5.0],
        covariance,
        t_last_used: [t.0, i64::MIN, i64::MIN, i64::MIN, i64::MIN],
        keyframes: 2,
        iterations: 1,
        linearised: 2,
        ..Solution::empty()
    }
}

/// Receives until `wanted` says that it has come.
fn await_message<T: Message>(what: &str, subscriber: &mut Subscriber<T>, wanted: impl Fn(&T) -> bool) -> Vec<T> {
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

/// Sends samples until an estimate is as `wanted`.
fn send_until(
    samples: &mut Publisher<ImuSample>,
    t: &mut f64,
    estimates: &mut Subscriber<NavEstimate>,
    wanted: impl Fn(&NavEstimate) -> bool,
) -> NavEstimate {
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        *t += 0.005;
        samples.publish(imu(*t));
        std::thread::sleep(Duration::from_millis(1));
        while let Some(estimate) = estimates.receive() {
            if wanted(&estimate) {
                return estimate;
            }
        }
        assert!(Instant::now() < deadline, "no such estimate within 10 s");
    }
}

fn await_running(bus: &Bus) {
    let mut health = bus.subscriber(&channel::HEALTH).unwrap();
    await_message("the first heartbeat", &mut health, |beat| {
        beat.process == Process::Propagator as u32 && beat.state == ProcessState::Running as u32
    });
}

#[test]
fn every_sample_that_counts_has_its_estimate_and_names_it() {
    let prefix = prefix("each");
    let _owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::EmulatorImu, 0).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    let mut estimates = bus.subscriber(&channel::ESTIMATE).unwrap();
    let process = Propagator::start(&prefix, 0);
    await_running(&bus);

    for step in 0..200 {
        let mut sample = imu(f64::from(step) * 0.005);
        if step == 100 {
            sample.gyro_body[0] = f64::NAN;
        }
        samples.publish(sample);
    }
    let all = await_message("the last estimate", &mut estimates, |estimate| estimate.header.origin_sequence == 199);
    let of_samples: Vec<_> =
        all.iter().filter(|e| e.header.origin_t_arrival > 0).map(|e| e.header.origin_sequence).collect();
    let expected: Vec<u64> = (0..200).filter(|&sequence| sequence != 100).collect();
    assert_eq!(of_samples, expected);
    assert!(all.iter().all(|estimate| estimate.mode() == Mode::Initialising));

    let mut health = bus.subscriber(&channel::HEALTH).unwrap();
    let beats = await_message("a heartbeat with all samples", &mut health, |beat| beat.sensors[0].received == 200);
    let beat = beats.last().unwrap();
    assert_eq!(beat.sensors[0].rejected[RejectReason::NotFinite.index()], 1);
    assert_eq!((beat.end_to_end.count, beat.dropped), (199, 0));
    process.stop();
}

#[test]
fn it_stands_on_the_newest_solution_and_says_when_the_imu_is_silent() {
    let prefix = prefix("stand");
    let _owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::Solver, 0).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    let mut solutions = bus.publisher(&channel::SOLUTION).unwrap();
    let mut estimates = bus.subscriber(&channel::ESTIMATE).unwrap();
    let process = Propagator::start(&prefix, 0);
    await_running(&bus);

    let mut t = 0.0;
    send_until(&mut samples, &mut t, &mut estimates, |_| true);
    solutions.publish(solution(7, t));
    let standing = send_until(&mut samples, &mut t, &mut estimates, |estimate| estimate.solution == 7);
    assert_eq!(standing.mode(), Mode::Ok);
    let drift = standing.position_enu.iter().zip([3.0, 4.0, -5.0]).map(|(p, at)| (p - at).abs()).fold(0.0, f64::max);
    assert!(drift < 0.1, "{:?}", standing.position_enu);

    let held = await_message("INVALID", &mut estimates, |estimate| estimate.mode() == Mode::Invalid);
    let held = held.last().unwrap();
    // Within four periods, but no sooner than the rhythm of a sample that is a little late.
    assert!(held.header.t_valid >= Time::from_seconds(t + 0.018).0, "{} s after {t} s", held.t_valid());
    assert_eq!(held.header.origin_t_arrival, 0);
    let back = send_until(&mut samples, &mut t, &mut estimates, |estimate| estimate.header.origin_t_arrival > 0);
    assert_ne!(back.mode(), Mode::Invalid);
    process.stop();
}

#[test]
fn restarted_it_goes_on_from_the_latched_solution_and_the_history_of_the_imu() {
    let prefix = prefix("restart");
    let owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::Solver, 0).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    let mut solutions = bus.publisher(&channel::SOLUTION).unwrap();
    let mut estimates = bus.subscriber(&channel::ESTIMATE).unwrap();
    let first = Propagator::start(&prefix, 0);
    await_running(&bus);
    let mut t = 0.0;
    send_until(&mut samples, &mut t, &mut estimates, |_| true);
    solutions.publish(solution(7, t));
    send_until(&mut samples, &mut t, &mut estimates, |estimate| estimate.solution == 7);
    first.stop();
    owner.cleanup_dead_nodes();
    // Nobody is there for these.
    for _ in 0..100 {
        t += 0.005;
        samples.publish(imu(t));
    }
    while estimates.receive().is_some() {}

    let second = Propagator::start(&prefix, 1);
    await_running(&bus);
    solutions.update();
    let standing = send_until(&mut samples, &mut t, &mut estimates, |estimate| estimate.solution == 7);
    assert_eq!(standing.header.epoch, 1);
    assert_eq!(standing.mode(), Mode::Ok, "the history bridged the time in which nobody listened");
    second.stop();
}
