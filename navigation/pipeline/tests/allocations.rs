//! After warm-up the navigator allocates nothing: neither per sample nor per keyframe.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

use nav_pipeline::{Navigator, Output, Rebase, Unmeasured};
use shared_types::{Config, ConfigText, Duration, RawReading, Time};
use sim_world::{Preset, Scenario, World};

struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

#[expect(unsafe_code, reason = "an allocator is unsafe by its trait; every call is handed to the system's")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
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
    // One counter for the whole process: one estimator after the other.
    for estimator in ["fgo", "ekf", "fkf"] {
        let facts = ConfigText::new("sensors.toml", world.sensors_toml());
        let sets = [format!("estimator={estimator}")];
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
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    readings[warm..].iter().for_each(|reading| navigator.push(reading, &mut Unmeasured, &mut sink));
    let allocated = ALLOCATIONS.load(Ordering::Relaxed) - before;
    assert_eq!(allocated, 0, "{estimator}: over {} readings", readings.len() - warm);
    assert!(keyframes > 100, "{estimator}: {keyframes} keyframes");
}
