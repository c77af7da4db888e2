//! A disk that takes nothing for a while, as a limit on the size of files that this process sets itself. It holds for the whole
//! process: hence one test, and a file of its own.
#![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]

use std::cell::Cell;
use std::time::{Duration, Instant};

use ilns_bus::{Bus, Owner, Prefix};
use ilns_recorder::{Args, McapArgs, run_until};
use ilns_recording::{LogDirectory, Summary};
use ilns_runtime::{ProcessArgs, Shutdown};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use shared_types::{Header, Heartbeat, ImuSample, Process, ProcessState, Time, channel};

const PERIOD: i64 = 5_000_000;

fn imu(step: i64) -> ImuSample {
    let header = Header { t_arrival: 1_000, ..Header::at(Time(step * PERIOD)) };
    ImuSample { header, gyro_body: [0.1; 3], accel_body: [0.0, 0.0, 9.8] }
}

/// Two more flushes than it had at the first look.
fn two_more() -> impl Fn(&Heartbeat) -> bool {
    let flushes = Cell::new(u64::MAX);
    move |beat| {
        flushes.set(flushes.get().min(beat.work.count));
        beat.work.count >= flushes.get() + 2
    }
}

#[test]
fn a_recorder_outlives_a_full_disk_counts_what_it_lost_and_goes_on_in_the_same_files() {
    let prefix = Prefix::new(&format!("r{}-disk", std::process::id())).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let owner = Owner::take(&prefix).unwrap();
    let bus = Bus::join(&prefix, Process::EmulatorImu, 0).unwrap();
    let mut samples = bus.publisher(&channel::IMU).unwrap();
    let mut health = bus.subscriber(&channel::HEALTH).unwrap();
    // As every process of the set has it: a write beyond the limit is an error and not its end.
    Shutdown::on_signals().unwrap();
    let args = Args {
        process: ProcessArgs {
            prefix: prefix.name().to_owned(),
            log_level: "error".to_owned(),
            ..ProcessArgs::default()
        },
        out: folder.path().join("out"),
        replace: false,
        mcap: McapArgs::default(),
    };
    let shutdown = Shutdown::default();
    let stop = shutdown.clone();
    let recorder = std::thread::spawn(move || run_until(&args, &stop));

    // Sends samples until the recorder has said what is wanted.
    let mut sent = 0;
    let mut send_until = |what: &str, wanted: &dyn Fn(&Heartbeat) -> bool| {
        let deadline = Instant::now() + Duration::from_secs(30);
        loop {
            assert!(Instant::now() < deadline, "{what}: not within 30 s");
            if health.newest().filter(|beat| beat.state == ProcessState::Running as u32).is_some_and(|b| wanted(&b)) {
                return sent;
            }
            samples.publish(imu(sent));
            sent += 1;
            std::thread::sleep(Duration::from_millis(1));
        }
    };
    // Its work is the flush: by then files are there and have rows.
    send_until("it writes", &|beat| beat.work.count >= 2);
    let whole = getrlimit(Resource::Fsize);
    setrlimit(Resource::Fsize, Rlimit { current: Some(0), ..whole }).unwrap();
    send_until("it counts", &|beat| beat.dropped > 100);
    setrlimit(Resource::Fsize, whole).unwrap();
    let before = send_until("it is asked again", &two_more());
    let sent = send_until("it goes on", &two_more());
    shutdown.request();
    recorder.join().unwrap().unwrap();

    let log = LogDirectory::open(folder.path().join("out")).unwrap();
    // Every row is whole: none was torn where the disk refused.
    let rows: Vec<i64> = log.imu().unwrap().map(|row| row.unwrap().header.t_valid / PERIOD).collect();
    let lost = Summary::read(folder.path().join("out/summary.json")).unwrap().lost;
    assert_eq!(rows[0], 0);
    assert!(rows.is_sorted_by(|a, b| a < b));
    assert!(rows.last().unwrap() > &before, "nothing was written after {before}");
    let missing = sent as u64 - rows.len() as u64;
    // A row at which the disk refused is counted and may stand there all the same.
    assert!(missing > 100 && (missing..=missing + 2).contains(&lost), "{missing} rows are missing, {lost} are counted");
    drop((samples, health, bus));
    owner.close();
}
