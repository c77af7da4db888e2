//! The bus from outside: owners, late readers, full queues, deaths. Each test has a prefix of its own.

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ilns_bus::{Bus, BusError, Losses, Owner, Prefix, Reader};
use shared_types::{Channel, FrameOrigin, Header, ImuSample, LblRange, NavEstimate, Process, PsDepth, channel};

/// A prefix that no other test has.
fn prefix(test: &str) -> Prefix {
    Prefix::new(&format!("t{}-{test}", std::process::id())).expect("short enough")
}

fn depth(depth: f64) -> PsDepth {
    PsDepth { header: Header::default(), depth }
}

fn imu() -> ImuSample {
    ImuSample { header: Header::default(), gyro_body: [0.0; 3], accel_body: [0.0, 0.0, 9.8] }
}

/// Names of everything on this machine that belongs to a prefix.
fn leftovers(prefix: &Prefix) -> Vec<String> {
    let named = |directory: &str| {
        std::fs::read_dir(directory)
            .expect("readable")
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
            .filter(|name| name.starts_with(&format!("ilns-{}", prefix.name())))
            .collect::<Vec<String>>()
    };
    [named("/dev/shm"), named("/tmp")].concat()
}

fn eventually(what: &str, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(10);
    while !holds() {
        assert!(Instant::now() < deadline, "{what} did not happen within 10 s");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Kills its child whatever happens.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs one of the ignored tests below as a process of its own.
fn start(role: &str, prefix: &Prefix) -> Guarded {
    let child = Command::new(std::env::current_exe().expect("this test"))
        .args(["--ignored", "--exact", role])
        .env("ILNS_TEST_PREFIX", prefix.name())
        .stdout(Stdio::null())
        .spawn();
    Guarded(child.expect("a test can start itself"))
}

fn prefix_of_role() -> Option<Prefix> {
    Some(Prefix::new(&std::env::var("ILNS_TEST_PREFIX").ok()?).expect("given by the test"))
}

#[test]
#[ignore = "the part of another process, started by other tests"]
fn role_owner() {
    let Some(prefix) = prefix_of_role() else { return };
    let _owner = Owner::take(&prefix).expect("nobody else has it");
    std::thread::sleep(Duration::from_secs(60));
}

#[test]
#[ignore = "the part of another process, started by other tests"]
fn role_reader() {
    let Some(prefix) = prefix_of_role() else { return };
    let bus = Bus::join(&prefix, Process::Recorder, 0).expect("the test owns it");
    let _silent = bus.subscriber(&channel::PS).expect("room for a reader");
    std::thread::sleep(Duration::from_secs(60));
}

#[test]
fn a_message_arrives_stamped() {
    let prefix = prefix("stamped");
    let _owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::EmulatorPs, 3).expect("owned");
    let reader = Bus::join(&prefix, Process::Preprocessor, 0).expect("owned");
    let mut depths = reader.subscriber(&channel::PS).expect("room");
    let mut publisher = sender.publisher(&channel::PS).expect("room");
    assert_eq!(publisher.publish(depth(1.5)).delivered, 1);
    assert_eq!(publisher.publish(depth(2.5)).sequence, 1);
    let (first, second) = (depths.receive().expect("sent"), depths.receive().expect("sent"));
    assert_eq!((first.depth, second.depth), (1.5, 2.5));
    let header = second.header;
    assert_eq!((header.sequence, header.epoch, header.schema), (1, 3, 1));
    assert_eq!(header.source, Process::EmulatorPs as u16);
    assert!(header.t_published >= first.header.t_published && first.header.t_published > 0);
    assert!(depths.receive().is_none());
}

#[test]
fn two_prefixes_side_by_side_do_not_hear_each_other() {
    // The one name begins with the other.
    let (here, there) = (prefix("side"), prefix("side-b"));
    let _owner_here = Owner::take(&here).expect("free");
    let owner_there = Owner::take(&there).expect("free");
    let mut heard_here = {
        let bus = Bus::join(&here, Process::Recorder, 0).expect("owned");
        bus.subscriber(&channel::PS).expect("room")
    };
    let sender = Bus::join(&there, Process::EmulatorPs, 0).expect("owned");
    let mut publisher = sender.publisher(&channel::PS).expect("room");
    assert_eq!(publisher.publish(depth(1.0)).delivered, 0);
    assert!(heard_here.receive().is_none());
    // Nor does one's end touch the other.
    drop((publisher, sender));
    owner_there.close();
    let sender = Bus::join(&here, Process::EmulatorPs, 0).expect("still owned");
    let mut publisher = sender.publisher(&channel::PS).expect("room");
    assert_eq!(publisher.publish(depth(2.0)).delivered, 1);
    assert_eq!(heard_here.receive().expect("sent here").depth, 2.0);
}

#[test]
fn a_prefix_in_use_names_its_owner_and_one_without_says_how_to_start() {
    let prefix = prefix("taken");
    assert!(matches!(Bus::join(&prefix, Process::Monitor, 0), Err(BusError::NotRunning { .. })));
    let owner = Owner::take(&prefix).expect("free");
    let error = Owner::take(&prefix).expect_err("taken");
    let pid = std::process::id().to_string();
    assert!(matches!(&error, BusError::InUse { pid: held_by, .. } if *held_by == pid), "{error}");
    assert!(error.to_string().contains("--prefix NAME"), "{error}");
    owner.close();
    Owner::take(&prefix).expect("free again").close();
}

#[test]
fn a_closed_owner_leaves_nothing_behind() {
    let prefix = prefix("closed");
    let owner = Owner::take(&prefix).expect("free");
    assert!(!leftovers(&prefix).is_empty());
    {
        let bus = Bus::join(&prefix, Process::EmulatorPs, 0).expect("owned");
        bus.publisher(&channel::PS).expect("room").publish(depth(1.0));
    }
    owner.close();
    assert_eq!(leftovers(&prefix), Vec::<String>::new());
}

#[test]
fn the_leftovers_of_a_killed_owner_are_wiped_by_the_next() {
    let prefix = prefix("killed");
    let mut child = start("role_owner", &prefix);
    eventually("the start of the owner", || Bus::join(&prefix, Process::Monitor, 0).is_ok());
    child.0.kill().expect("it lives");
    child.0.wait().expect("it was killed");
    assert!(matches!(Bus::join(&prefix, Process::Monitor, 0), Err(BusError::NotRunning { .. })));
    assert!(leftovers(&prefix).len() > 10, "a killed owner cleans nothing up: {:?}", leftovers(&prefix));
    let owner = Owner::take(&prefix).expect("the lock died with its holder");
    let sender = Bus::join(&prefix, Process::EmulatorPs, 0).expect("owned");
    sender.publisher(&channel::PS).expect("room").publish(depth(1.0));
    drop(sender);
    owner.close();
    assert_eq!(leftovers(&prefix), Vec::<String>::new());
}

#[test]
fn whoever_takes_over_from_a_killed_owner_finds_the_folder_of_its_run_and_whoever_takes_the_prefix_does_not() {
    let prefix = prefix("heir");
    let kept = prefix.run_directory().join("kept");
    let mut child = start("role_owner", &prefix);
    eventually("the start of the owner", || Bus::join(&prefix, Process::Monitor, 0).is_ok());
    std::fs::create_dir_all(prefix.run_directory()).expect("the owner has made its directory");
    std::fs::write(&kept, "of the run").expect("writable");
    child.0.kill().expect("it lives");
    child.0.wait().expect("it was killed");
    let heir = Owner::take_over(&prefix).expect("the lock died with its holder");
    assert!(kept.exists());
    let sender = Bus::join(&prefix, Process::EmulatorPs, 0).expect("owned");
    sender.publisher(&channel::PS).expect("room").publish(depth(1.0));
    drop(sender);
    // As if killed, too: its destructor does not run.
    std::mem::forget(heir);
    std::fs::remove_file(prefix.directory().join("lock")).expect("the test holds the lock");
    Owner::take(&prefix).expect("the lock is gone").close();
    assert_eq!(leftovers(&prefix), Vec::<String>::new());
}

#[test]
fn a_connection_that_a_killed_process_was_just_creating_does_not_hang_the_owner() {
    let prefix = prefix("unborn");
    let owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::EmulatorPs, 0).expect("owned");
    let mut publisher = sender.publisher(&channel::PS).expect("room");
    let mut child = start("role_reader", &prefix);
    eventually("the reader", || publisher.publish(depth(1.0)).delivered == 1);
    let connection = leftovers(&prefix).into_iter().find(|name| name.ends_with(".connection")).expect("there is one");
    child.0.kill().expect("it lives");
    child.0.wait().expect("it was killed");
    // Another one to the same reader, of a sender of the same dead process, as it is between its creation and its first size.
    let (start, reader) = connection.rsplit_once('_').expect("sender and reader");
    let (channel, _) = start.rsplit_once('_').expect("channel and sender");
    let id: u128 = reader.trim_end_matches(".connection").parse().expect("a number");
    let unborn = std::path::Path::new("/dev/shm").join(format!("{channel}_{}_{reader}", id + 1));
    std::fs::write(&unborn, []).expect("writable");
    assert_eq!(owner.cleanup_dead_nodes(), 1);
    assert!(!unborn.exists());
    // What the living are just creating is left alone.
    let mine = (u128::from(std::process::id()) << 64) | 7;
    let alive = std::path::Path::new("/dev/shm").join(format!("{channel}_{mine}_{mine}.connection"));
    std::fs::write(&alive, []).expect("writable");
    owner.cleanup_dead_nodes();
    assert!(alive.exists());
    drop(publisher);
    drop(sender);
    owner.close();
    assert_eq!(leftovers(&prefix), Vec::<String>::new());
}

#[test]
fn a_late_reader_gets_the_latched_message() {
    let prefix = prefix("late");
    let _owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::Preprocessor, 0).expect("owned");
    let mut publisher = sender.publisher(&channel::FRAME_ORIGIN).expect("room");
    let origin = FrameOrigin { header: Header::default(), lat_deg: 61.0, lon_deg: 10.0, height: 40.0 };
    publisher.publish(FrameOrigin { lat_deg: 1.0, ..origin });
    publisher.publish(origin);
    let reader = Bus::join(&prefix, Process::Solver, 0).expect("owned");
    let mut late = reader.subscriber(&channel::FRAME_ORIGIN).expect("room");
    let mut guest = reader.subscriber_since(&channel::FRAME_ORIGIN, 0).expect("room");
    publisher.update();
    assert_eq!(late.receive().expect("latched").lat_deg, 61.0);
    assert!(late.receive().is_none());
    assert!(guest.receive().is_none());
    assert_eq!(late.losses(), Losses::default());
}

#[test]
fn a_restarted_reader_catches_up_from_the_history_of_the_imu() {
    let prefix = prefix("history");
    let _owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::EmulatorImu, 0).expect("owned");
    let mut publisher = sender.publisher(&channel::IMU).expect("room");
    let history = channel::IMU.spec.history as u64;
    for _ in 0..history + 88 {
        publisher.publish_quietly(imu());
    }
    let reader = Bus::join(&prefix, Process::Propagator, 1).expect("owned");
    let mut samples = reader.subscriber(&channel::IMU).expect("room");
    publisher.publish(imu());
    let first = samples.receive().expect("history").header.sequence;
    assert_eq!(first, 88);
    while samples.receive().is_some() {}
    assert_eq!(samples.received(), history + 1);
    assert_eq!(samples.losses(), Losses::default());
}

#[test]
fn a_full_queue_refuses_the_newest_and_the_sender_counts_it() {
    let prefix = prefix("full");
    let _owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::EmulatorPs, 0).expect("owned");
    let reader = Bus::join(&prefix, Process::Preprocessor, 0).expect("owned");
    let mut publisher = sender.publisher(&channel::PS).expect("room");
    let mut slow = reader.subscriber(&channel::PS).expect("room");
    let mut brisk = reader.subscriber(&channel::PS).expect("room");
    let queue = channel::PS.spec.queue as u64;
    for _ in 0..queue + 5 {
        publisher.publish(depth(1.0));
        while brisk.receive().is_some() {}
    }
    assert_eq!(publisher.dropped(), 5);
    assert_eq!(brisk.losses(), Losses::default());
    let published = publisher.publish(depth(1.0));
    assert_eq!((published.delivered, published.refused), (1, 1));
    // The oldest are still there, the gap shows with the next that gets through.
    assert_eq!(slow.receive().expect("queued").header.sequence, 0);
    while slow.receive().is_some() {}
    assert_eq!(slow.lost(), 0);
    publisher.publish(depth(1.0));
    slow.receive().expect("there is room again");
    assert_eq!((slow.lost(), publisher.dropped()), (6, 6));
}

#[test]
fn an_overtaken_reader_loses_the_oldest_and_counts_it() {
    let prefix = prefix("overflow");
    let _owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::Propagator, 0).expect("owned");
    let reader = Bus::join(&prefix, Process::Monitor, 0).expect("owned");
    let mut publisher = sender.publisher(&channel::ESTIMATE).expect("room");
    let mut estimates = reader.subscriber(&channel::ESTIMATE).expect("room");
    let estimate = NavEstimate {
        header: Header::default(),
        solution: 0,
        t_keyframe: 0,
        position_enu: [0.0; 3],
        velocity_enu: [0.0; 3],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: [0.0; 6],
        velocity_cov: [0.0; 6],
        attitude_cov: [0.0; 6],
        sigma_rpy: [0.0; 3],
        lat_lon_h: [0.0; 3],
        aiding_age: [0.0; 5],
        mode: 0,
        reserved: 0,
    };
    publisher.publish(estimate);
    estimates.receive().expect("sent");
    let queue = channel::ESTIMATE.spec.queue as u64;
    for _ in 0..queue + 7 {
        assert_eq!(publisher.publish(estimate).refused, 0);
    }
    assert_eq!(estimates.newest().expect("sent").header.sequence, queue + 7);
    assert_eq!((estimates.lost(), publisher.dropped()), (7, 0));
}

#[test]
fn a_second_driver_is_refused() {
    let prefix = prefix("second");
    let _owner = Owner::take(&prefix).expect("free");
    let bus = Bus::join(&prefix, Process::EmulatorImu, 0).expect("owned");
    let _first = bus.publisher(&channel::IMU).expect("room");
    assert!(matches!(bus.publisher(&channel::IMU), Err(BusError::Crowded { channel: "sensor/imu", .. })));
}

#[test]
fn a_reader_of_another_layout_is_refused() {
    let prefix = prefix("layout");
    let _owner = Owner::take(&prefix).expect("free");
    let bus = Bus::join(&prefix, Process::Preprocessor, 0).expect("owned");
    // A channel that claims to carry something else than it was created for, as a process of another build would.
    let mut claimed: Channel<LblRange> = channel::LBL;
    claimed.spec = channel::PS.spec;
    let error = bus.subscriber(&claimed).expect_err("another type");
    assert!(matches!(error, BusError::OtherBuild { channel: "sensor/ps" }), "{error}");
}

#[test]
fn only_the_one_who_must_wake_is_woken() {
    let prefix = prefix("bells");
    let _owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::EmulatorImu, 0).expect("owned");
    let reader = Bus::join(&prefix, Process::Propagator, 0).expect("owned");
    let (fast, slow) = (reader.waiter(Reader::Propagator), reader.waiter(Reader::Preprocessor));
    let (fast, slow) = (fast.expect("room"), slow.expect("room"));
    let mut publisher = sender.publisher(&channel::IMU).expect("room");
    let none = Duration::from_millis(1);
    publisher.publish_quietly(imu());
    assert!(!fast.wait_for(none), "published quietly");
    publisher.ring();
    assert!(fast.wait());
    for _ in 0..7 {
        publisher.publish(imu());
    }
    assert!(!slow.wait_for(none), "eight samples wake nobody who can wait for ten");
    publisher.publish(imu());
    publisher.publish(imu());
    assert!(slow.wait() && fast.wait());
    assert!(!fast.wait_for(none), "rings are heard once");
}

#[test]
fn a_killed_reader_is_cleaned_up_after_and_its_place_is_free() {
    let prefix = prefix("dead");
    let owner = Owner::take(&prefix).expect("free");
    let sender = Bus::join(&prefix, Process::EmulatorPs, 0).expect("owned");
    let mut publisher = sender.publisher(&channel::PS).expect("room");
    let mut child = start("role_reader", &prefix);
    eventually("the reader's start", || publisher.publish(depth(1.0)).delivered == 1);
    child.0.kill().expect("it lives");
    child.0.wait().expect("it was killed");
    assert_eq!(owner.cleanup_dead_nodes(), 1);
    assert_eq!(publisher.publish(depth(1.0)).delivered, 0);
}
