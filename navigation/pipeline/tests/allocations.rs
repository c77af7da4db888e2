//! After warm-up the navigator allocates nothing: neither per sample nor per keyframe.
//!
//! `ILNS_KEYFRAMES=10000 cargo test --release -p nav-pipeline --test allocations -- --nocapture` runs ten thousand keyframes and, with
//! an IMU of 1 kHz, ten million samples through the smoother, and prints the counts.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use nav_pipeline::{Navigator, Output, Rebase, Unmeasured};
use shared_types::{Config, ConfigText, Duration, RawReading, Time};
use sim_world::{Manoeuvre, Preset, Scenario, Segment, World};

struct Counting;

thread_local! {
    /// Of this thread: the harness allocates, too, when it says that a test is slow.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

fn count() {
    // A thread that is ending has no counter any more, and is not watched.
    let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
}

#[expect(unsafe_code, reason = "an allocator is unsafe by its trait; every call is handed to the system's")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count();
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn after_warm_up_nothing_is_allocated() {
    let scenario = Scenario::builtin("mission").expect("a built-in scenario");
    let world = World::new(&scenario, Preset::Realistic, 1).expect("a valid world");
    let readings: Vec<RawReading> =
        world.readings().take_while(|reading| reading.t_valid() < Time::from_seconds(140.0)).collect();
    let moored = "lbl.buoy_sigma=0.3";
    for (estimator, also) in [("fgo", None), ("fgo", Some(moored)), ("ekf", None), ("fkf", None)] {
        let facts = ConfigText::new("sensors.toml", world.sensors_toml());
        let sets: Vec<String> = [format!("estimator={estimator}")].into_iter().chain(also.map(str::to_owned)).collect();
        let config = Config::load(&[facts], &sets).expect("a valid configuration");
        run(estimator, &config, &readings);
    }
}

fn run(estimator: &str, config: &Config, readings: &[RawReading]) {
    let mut readings = readings.to_vec();
    if config.navigator.estimator.is_filter() {
        // Depths come 3 s late and are taken in by rolling back.
        let delay =
            |reading: &RawReading| Duration::from_seconds(if matches!(reading, RawReading::Ps(_)) { 3.0 } else { 0.0 });
        readings.sort_by_key(|reading| reading.t_valid() + delay(reading));
    }
    let mut navigator = Navigator::new(config, Rebase::After(Duration::ZERO));
    let is_warm =
        |reading: &RawReading| matches!(reading, RawReading::Imu(_)) && reading.t_valid() >= Time::from_seconds(70.0);
    let warm = readings.iter().position(is_warm).expect("the mission is longer");
    let mut keyframes = 0;
    let mut sink = |output: Output<'_>| {
        if let Output::Solution(..) = output {
            keyframes += 1;
        }
    };
    readings[..warm].iter().for_each(|reading| navigator.push(reading, &mut Unmeasured, &mut sink));
    let before = allocations();
    readings[warm..].iter().for_each(|reading| navigator.push(reading, &mut Unmeasured, &mut sink));
    let allocated = allocations() - before;
    assert_eq!(allocated, 0, "{estimator}: over {} readings", readings.len() - warm);
    assert!(keyframes > 100, "{estimator}: {keyframes} keyframes");
}

/// Keyframes of the long run: `ILNS_KEYFRAMES`, or a fraction that takes a second.
fn keyframes_wanted() -> u64 {
    std::env::var("ILNS_KEYFRAMES").ok().and_then(|text| text.parse().ok()).unwrap_or(300)
}

#[test]
fn over_a_long_mission_at_a_kilohertz_nothing_is_allocated_in_any_cycle() {
    let wanted = keyframes_wanted();
    // The mission's dive, and then circles to the left and to the right below the net: one keyframe and a thousand samples a second.
    let mut scenario = Scenario::builtin("mission").expect("a built-in scenario");
    scenario.segments.retain(|segment| segment.end <= 560.0);
    let (mut start, mut side) = (560.0, 1.0);
    while start < wanted as f64 + 200.0 {
        let manoeuvre = Manoeuvre::Turn { rate: side * 1.0_f64.to_radians() };
        scenario.segments.push(Segment { start, end: start + 360.0, manoeuvre });
        (start, side) = (start + 360.0, -side);
    }
    scenario.imu.as_mut().expect("it has one").schedule.rate = 1_000.0;
    let world = World::new(&scenario, Preset::Realistic, 1).expect("a valid world");
    let facts = ConfigText::new("sensors.toml", world.sensors_toml());
    let config = Config::load(&[facts], &[]).expect("a valid configuration");
    let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
    let (mut keyframes, mut cycles, mut allocated, mut is_warm) = (0_u64, 0_u64, 0_u64, false);
    for reading in world.readings() {
        // The world itself allocates: only the navigator's own calls are counted.
        let before = allocations();
        let mut solutions = 0;
        navigator.push(&reading, &mut Unmeasured, &mut |output: Output<'_>| {
            solutions += u64::from(matches!(output, Output::Solution(..)));
        });
        if is_warm {
            allocated += allocations() - before;
            keyframes += solutions;
            cycles += u64::from(matches!(reading, RawReading::Imu(_)));
            if keyframes == wanted {
                break;
            }
        }
        is_warm |= reading.t_valid() >= Time::from_seconds(70.0);
    }
    eprintln!("{allocated} allocations in {cycles} propagator cycles and {keyframes} keyframes");
    assert_eq!(allocated, 0, "in {cycles} propagator cycles and {keyframes} keyframes");
    assert!(keyframes == wanted && cycles >= 990 * wanted, "{cycles} cycles, {keyframes} keyframes");
}
