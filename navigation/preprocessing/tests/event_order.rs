//! The same readings give the same measurements, however the channels were interleaved.
#![expect(clippy::expect_used, reason = "a test may fail where it stands")]

mod readings;

use nav_preprocessing::Preprocessor;
use proptest::prelude::*;
use readings::{buoy, config, dvl, gnss, lbl, mcp, ps, raw_imu};
use shared_types::{Measurement, RawReading, Time};

/// Twelve seconds of all sensors at rates that beat against each other; buoy 2 drifts; some readings share an instant.
fn mission() -> Vec<RawReading> {
    let mut all = vec![buoy(0.0, 1)];
    all.extend((0..2400).map(|step| raw_imu(f64::from(step) * 0.005)));
    for step in 0..12 {
        let t = f64::from(step) + 0.2;
        if let RawReading::Buoy(fix) = buoy(t - 0.1, 2) {
            let lat_deg = fix.lat_deg + f64::from(step) * 1e-6;
            all.push(RawReading::Buoy(shared_types::BuoyFix { moored: 0, lat_deg, ..fix }));
        }
        all.extend([lbl(t, 1, 40.0 + t), lbl(t, 2, 50.0 + t), gnss(t, 1e-6 * t)]);
    }
    all.extend((0..60).map(|step| dvl(f64::from(step) * 0.2, 0.5)));
    all.extend((0..100).map(|step| mcp(f64::from(step) * 0.12, 45.0)));
    all.extend((0..100).map(|step| ps(f64::from(step) * 0.11, 0.5 + f64::from(step) * 0.03)));
    all
}

/// Delivers by `t_valid` plus a delay of each reading; order within a channel is kept, as a queue keeps it.
fn delivered(delays: impl Fn(usize, &RawReading) -> i64) -> Vec<Measurement> {
    let mut queue: Vec<(i64, usize, RawReading)> = Vec::new();
    let mut t_last_in_channel = [i64::MIN; 7];
    let mut readings = mission();
    readings.sort_by_key(RawReading::t_valid);
    for (index, reading) in readings.into_iter().enumerate() {
        let newest = &mut t_last_in_channel[reading.sensor().index()];
        *newest = (reading.t_valid().0 + delays(index, &reading)).max(*newest);
        queue.push((*newest, index, reading));
    }
    queue.sort_by_key(|&(t_delivery, index, _)| (t_delivery, index));
    let mut preprocessor = Preprocessor::new(&config());
    let mut out = Vec::new();
    for (_, _, reading) in &queue {
        preprocessor.push(reading, &mut |measurement| out.push(measurement));
    }
    preprocessor.finish(&mut |measurement| out.push(measurement));
    out
}

/// Below `keyframes.settle`, less one IMU period: what waits for 50 ms of IMU is there by then.
const DELAY_MAX: i64 = 44_000_000;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn interleavings_within_the_settle_time_change_nothing(
        delays in prop::collection::vec(0..DELAY_MAX, 512),
    ) {
        let in_order = delivered(|_, _| 0);
        let shuffled = delivered(|index, reading| match reading {
            RawReading::Imu(_) => 0,
            _ => delays[(index * 7) % delays.len()],
        });
        prop_assert_eq!(in_order.len(), shuffled.len());
        for (expected, found) in in_order.iter().zip(&shuffled) {
            prop_assert_eq!(expected, found);
        }
    }
}

#[test]
fn the_mission_of_this_test_uses_every_kind_of_measurement() {
    let out = delivered(|_, _| 0);
    for kind in [0, 1, 2, 3, 4, 5, Measurement::KEYFRAME] {
        assert!(out.iter().any(|measurement| measurement.kind == kind), "kind {kind}");
    }
}

#[test]
fn a_delay_beyond_the_settle_time_does_change_the_order() {
    let in_order = delivered(|_, _| 0);
    let late = delivered(|_, reading| if matches!(reading, RawReading::Lbl(_)) { 400_000_000 } else { 0 });
    assert_ne!(in_order, late, "else the test above could not fail");
}

#[test]
fn measurements_stand_in_the_order_of_the_contract() {
    let out = delivered(|_, _| 0);
    let mut keyframes: Vec<Time> = Vec::new();
    let mut batch: Vec<&Measurement> = Vec::new();
    for measurement in out.iter().filter(|measurement| measurement.kind != 0) {
        if measurement.kind != Measurement::KEYFRAME {
            batch.push(measurement);
            continue;
        }
        let t = measurement.t_keyframe();
        let t_before = keyframes.last().copied().unwrap_or(Time::MIN);
        assert!(batch.is_sorted_by_key(|reading| reading.t_valid()), "batch of the keyframe at {t}");
        for reading in batch.drain(..) {
            assert!(t_before < reading.t_valid() && reading.t_valid() <= t, "{reading:?} in the batch of {t}");
            let anchor = reading.t_keyframe();
            assert!(anchor == t || anchor == t_before, "{reading:?} in the batch of {t}");
            let (offset, other) = (reading.t_valid() - anchor, if anchor == t { t_before } else { t });
            assert!(offset.abs() <= (reading.t_valid() - other).abs(), "{reading:?} is nearer to {other}");
        }
        keyframes.push(t);
    }
    assert!(batch.is_empty());
    assert!(keyframes.windows(2).all(|pair| pair[1] - pair[0] >= config().navigator.keyframes.min_spacing));
    let last = keyframes.last().expect("there were keyframes");
    assert_eq!(*last, Time::from_seconds(11.995), "the finish closes at the last sample");
}
