//! After warm-up nothing is allocated in the loops of driver, propagator and solver: they are run here as threads, over
//! shared memory, with an allocator that counts what each of them asks for and shows where it first did.
//!
//! One exception is the shared memory layer's own: for each message that is sent it takes a handle of a few words from the
//! thread's free list and gives it back within the same call. It is told from everything else by its size, and there may be
//! no more of them than messages.
//!
//! `ILNS_KEYFRAMES=10000 cargo test --release --test allocations -- --nocapture` watches ten thousand keyframes and, with an IMU of
//! 1 kHz, ten million samples; at ten times real time that takes a quarter of an hour.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ilns_bus::{Owner, Prefix};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Shutdown, StartClock, monotonic_now};
use shared_types::{Process, Time, channel};
use sim_emulators::process::EmulatorArgs;
use sim_emulators::simulate::PresetName;
use sim_emulators::source::{Source, SourceArgs};

const LOOPS: [&str; 3] = ["driver", "propagator", "solver"];

/// Allocations per loop since they are watched, but for the layer's handles.
static ALLOCATIONS: [AtomicU64; LOOPS.len()] = [const { AtomicU64::new(0) }; LOOPS.len()];
/// The layer's handles per loop since they are watched.
static HANDLES: [AtomicU64; LOOPS.len()] = [const { AtomicU64::new(0) }; LOOPS.len()];
/// Size of such a handle, once it is known.
static HANDLE_SIZE: AtomicUsize = AtomicUsize::new(0);
/// Size of the last allocation of a calibrating thread.
static CALIBRATED: AtomicUsize = AtomicUsize::new(0);
const CALIBRATING: usize = usize::MAX - 1;
static WATCHED: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// Index of the loop that this thread is; `usize::MAX`: none.
    static LOOP: Cell<usize> = const { Cell::new(usize::MAX) };
}

struct Trap;

impl Trap {
    fn enter(layout: Layout) {
        let Ok(index) = LOOP.try_with(Cell::get) else { return };
        if index == CALIBRATING {
            CALIBRATED.store(layout.size(), Ordering::Relaxed);
        }
        if index >= LOOPS.len() || !WATCHED.load(Ordering::Relaxed) {
            return;
        }
        if layout.size() == HANDLE_SIZE.load(Ordering::Relaxed) {
            HANDLES[index].fetch_add(1, Ordering::Relaxed);
            return;
        }
        if ALLOCATIONS[index].fetch_add(1, Ordering::Relaxed) == 0 {
            // What follows allocates, too.
            LOOP.with(|this| this.set(usize::MAX));
            let place = std::backtrace::Backtrace::force_capture();
            eprintln!("{} allocates {} bytes:\n{place}", LOOPS[index], layout.size());
            LOOP.with(|this| this.set(index));
        }
    }
}

#[expect(unsafe_code, reason = "an allocator is unsafe by its trait; every call is handed to the system's")]
unsafe impl GlobalAlloc for Trap {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Trap::enter(layout);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        Trap::enter(layout);
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

#[global_allocator]
static ALLOCATOR: Trap = Trap;

/// Seconds of data time per second.
const RATE: f64 = 10.0;

/// Solutions before the loops are watched: the window is full, and its arrays have the size that they keep.
const WARM_UP: usize = 40;

/// Solutions while they are watched, unless `ILNS_KEYFRAMES` says otherwise.
const WATCH: usize = 60;

const STABLE: &str = include_str!("../deploy/scenarios/stable.toml");

/// The built-in `stable`, or as it is for so many keyframes: long enough, with an IMU of 1 kHz.
fn scenario(keyframes: Option<usize>, folder: &Path) -> String {
    let Some(keyframes) = keyframes else { return "stable".to_owned() };
    let mut scenario: toml::Table = toml::from_str(STABLE).expect("a test parses every built-in scenario");
    scenario["imu"]["rate"] = toml::Value::Float(1_000.0);
    // In circles, so that it stays within reach of its buoys.
    let until = keyframes as f64 * 1.1 + 600.0;
    let circles = format!("manoeuvre = \"turn\"\nrate = 1.0\nuntil = {until:.1}\n");
    scenario["segment"][2] = toml::Value::Table(toml::from_str(&circles).expect("it is TOML"));
    let file = folder.join("long.toml");
    std::fs::write(&file, scenario.to_string()).expect("writable");
    file.to_str().expect("temporary paths are text").to_owned()
}

fn start(name: &'static str, body: impl FnOnce() -> Result<(), String> + Send + 'static) -> JoinHandle<()> {
    let index = LOOPS.iter().position(|&each| each == name).unwrap_or(usize::MAX);
    std::thread::spawn(move || {
        LOOP.with(|this| this.set(index));
        if let Err(error) = body() {
            panic!("{name}: {error}");
        }
        LOOP.with(|this| this.set(usize::MAX));
    })
}

/// What one sent message allocates in the shared memory layer.
fn learn_handle_size(owner: &Owner) {
    let mut port = owner.bus().publisher(&channel::HEALTH).expect("room");
    let beat = HeartbeatBuilder::new(Process::Recorder, 0).build();
    port.publish(beat);
    LOOP.with(|this| this.set(CALIBRATING));
    port.publish(beat);
    LOOP.with(|this| this.set(usize::MAX));
    HANDLE_SIZE.store(CALIBRATED.load(Ordering::Relaxed), Ordering::Relaxed);
}

#[test]
fn driver_propagator_and_solver_allocate_nothing_once_they_are_warm() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let wanted: Option<usize> = std::env::var("ILNS_KEYFRAMES").ok().and_then(|text| text.parse().ok());
    let watch = wanted.unwrap_or(WATCH);
    let prefix = Prefix::new(&format!("a{}", std::process::id())).expect("short enough");
    let owner = Owner::take(&prefix).expect("free");
    let source = SourceArgs {
        scenario: scenario(wanted, folder.path()),
        log: None,
        seed: 1,
        preset: PresetName::Realistic,
        faults: Vec::new(),
        fault_seed: None,
    };
    let facts = Source::open(&source).expect("built in").config().expect("a scenario has facts").text;
    let config = folder.path().join("sensors.toml");
    std::fs::write(&config, facts).expect("writable");
    // Just before the estimation starts.
    let clock = StartClock { data: Time::from_seconds(16.5), mono: monotonic_now() + 800_000_000, rate: RATE };
    let process = ProcessArgs {
        prefix: prefix.name().to_owned(),
        config: Some(config),
        start: Some(clock),
        ..ProcessArgs::default()
    };
    let shutdown = Shutdown::default();
    learn_handle_size(&owner);
    // A reader that comes later would have the propagator map his memory while it is watched.
    let mut estimates = owner.bus().subscriber_since(&channel::ESTIMATE, 0).expect("room");
    let mut solutions = owner.bus().subscriber(&channel::SOLUTION).expect("room");

    let said = |error: &dyn std::error::Error| error.to_string();
    let mut threads = Vec::new();
    let (args, stop) = (process.clone(), shutdown.clone());
    threads.push(start("propagator", move || {
        ilns_propagator::run_until(&ilns_propagator::Args { process: args }, &stop).map_err(|e| said(&e))
    }));
    let (args, stop) = (process.clone(), shutdown.clone());
    threads.push(start("solver", move || {
        ilns_solver::run_until(&ilns_solver::Args { process: args, keep: None }, &stop).map_err(|e| said(&e))
    }));
    let (args, stop) = (process.clone(), shutdown.clone());
    threads.push(start("preprocessor", move || {
        ilns_preprocessor::run_until(&ilns_preprocessor::Args { process: args, keep: None }, &stop)
            .map_err(|e| said(&e))
    }));
    use Process::{EmulatorBuoys, EmulatorDvl, EmulatorImu, EmulatorLbl, EmulatorMcp, EmulatorPs};
    for emulator in [EmulatorBuoys, EmulatorLbl, EmulatorDvl, EmulatorMcp, EmulatorPs, EmulatorImu] {
        let args = EmulatorArgs { process: process.clone(), source: source.clone(), duration: None, rate: RATE };
        let stop = shutdown.clone();
        let name = if emulator == EmulatorImu { "driver" } else { "another driver" };
        threads
            .push(start(name, move || sim_emulators::process::run_until(emulator, &args, stop).map_err(|e| said(&e))));
    }

    let mut await_solutions = |wanted: usize| {
        // Without load a tenth of a second each.
        let deadline = Instant::now() + Duration::from_secs(120) + Duration::from_millis(500) * wanted as u32;
        let mut seen = 0;
        while seen < wanted {
            assert!(Instant::now() < deadline, "{seen} of {wanted} solutions in good time");
            assert!(threads.iter().all(|thread| !thread.is_finished()), "one of them has ended");
            seen += std::iter::from_fn(|| solutions.receive()).count();
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    await_solutions(WARM_UP);
    while estimates.receive().is_some() {}
    let sent_before = estimates.received() + estimates.lost();
    let begun = Instant::now();
    WATCHED.store(true, Ordering::Relaxed);
    await_solutions(watch);
    WATCHED.store(false, Ordering::Relaxed);
    shutdown.request();
    for thread in threads {
        thread.join().expect("it ran well");
    }
    while estimates.receive().is_some() {}
    // Whatever the queue could not hold was sent, too. Each loop sends heartbeats, and the solver a report a solution.
    let sent = estimates.received() + estimates.lost() - sent_before;
    let counted = |counts: &[AtomicU64; LOOPS.len()]| -> Vec<(&str, u64)> {
        LOOPS.into_iter().zip(counts.iter().map(|count| count.load(Ordering::Relaxed))).collect()
    };
    eprintln!("{:?} allocations in {sent} propagator cycles and {watch} keyframes", counted(&ALLOCATIONS));
    let beats = begun.elapsed().as_secs() * 2 + 4;
    drop((solutions, estimates));
    owner.close();
    assert_eq!(counted(&ALLOCATIONS), LOOPS.map(|name| (name, 0)), "loop and allocations over {watch} keyframes");
    for (name, handles) in counted(&HANDLES) {
        assert!(handles <= sent + beats, "{name}: {handles} handles for {sent} messages and {beats} heartbeats");
    }
    assert!(sent > 10_000, "{sent} estimates in a minute of data time");
}
