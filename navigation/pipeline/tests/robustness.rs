//! Bad data, missing sensors, a state gone wrong: nothing panics, nothing is NaN, and it comes back.

mod runs;

use nav_pipeline::{Navigator, Output, Rebase, Unmeasured};
use proptest::prelude::*;
use runs::{Run, assert_finite};
use shared_types::{
    Config, Duration, DvlVelocity, GnssFix, Header, ImuSample, LblRange, McpHeading, PsDepth, RawReading, Sensor,
    SolutionStatus, Time,
};
use sim_world::Preset;

const MISSION: Run<'static> = Run { scenario: "mission", preset: Preset::Realistic, seed: 2, sets: &[], until: 150.0 };

#[test]
fn every_subset_of_the_sensors_navigates() {
    let names = ["lbl", "gnss", "dvl", "mcp", "ps"];
    for subset in 0..32_u32 {
        let sets: Vec<String> =
            (0..5).filter(|bit| subset & (1 << bit) == 0).map(|bit| format!("{}.enabled=false", names[bit])).collect();
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        let ran = Run { sets: &sets, until: 60.0, ..MISSION }.go();
        let last = ran.pairs.last().expect("it published");
        for axis in 0..3 {
            let (error, sigma) = (last.position_error_enu[axis].abs(), last.estimate.sigma_position_enu[axis]);
            assert!(error < 4.5 * sigma, "subset {subset:05b}, axis {axis}: {error} m, sigma {sigma} m");
        }
    }
}

#[test]
fn multipath_on_a_tenth_of_the_ranges_is_refused() {
    let mut index = 0_u32;
    let clean = MISSION.go();
    let hostile = MISSION.with(|reading| match reading {
        RawReading::Lbl(mut range) => {
            index += 1;
            if index % 10 == 3 {
                range.range += 5.0 + f64::from(index % 97);
            }
            Some(RawReading::Lbl(range))
        }
        other => Some(other),
    });
    let (clean, hostile_rms) = (clean.score.rms_horizontal, hostile.score.rms_horizontal);
    assert!(hostile_rms < 1.25 * clean + 0.01, "{hostile_rms} m against {clean} m");
    let gated = hostile.navigator.counts()[Sensor::Lbl.index()].rejected_total();
    assert!(gated > 40, "{gated} of some 53 outliers refused");
}

#[test]
fn an_inertial_glitch_that_no_noise_explains_is_recovered_from() {
    // For two seconds the accelerometer says 3 m/s² too much: 6 m/s and soon tens of metres, at sigmas of centimetres.
    let sets = ["dvl.enabled=false", "gnss.enabled=false", "mcp.enabled=false"];
    let ran = Run { sets: &sets, ..MISSION }.with(|reading| match reading {
        RawReading::Imu(mut sample) if (80.0..82.0).contains(&Time(sample.header.t_valid).as_seconds()) => {
            sample.accel_body[0] += 3.0;
            Some(RawReading::Imu(sample))
        }
        other => Some(other),
    });
    assert!(ran.solutions.iter().any(|s| s.status == SolutionStatus::Loosened as u32), "the state was suspected");
    for pair in ran.pairs.iter().filter(|pair| pair.estimate.t.as_seconds() > 120.0) {
        let error = pair.position_error_enu.xy().norm();
        assert!(error < 2.0, "{error} m at {}", pair.estimate.t);
    }
}

#[test]
fn a_second_without_inertial_data_is_bridged() {
    let ran = MISSION.with(|reading| {
        let is_gap = matches!(reading, RawReading::Imu(_)) && (90.0..91.0).contains(&reading.t_valid().as_seconds());
        (!is_gap).then_some(reading)
    });
    for pair in ran.pairs.iter().filter(|pair| pair.estimate.t.as_seconds() > 100.0) {
        let (error, sigma) = (pair.position_error_enu, pair.estimate.sigma_position_enu);
        assert!((0..2).all(|axis| error[axis].abs() < 4.5 * sigma[axis] && error[axis].abs() < 0.4), "{pair:?}");
    }
}

#[test]
fn repeated_late_and_broken_readings_change_little() {
    let clean = MISSION.go();
    let mut held: Option<RawReading> = None;
    let mut index = 0_u32;
    let hostile = MISSION.with(|reading| {
        index += 1;
        match reading {
            // Every 50th aiding reading is broken, and every other 25th comes in place of its successor.
            RawReading::Ps(mut depth) if index.is_multiple_of(50) => {
                depth.depth = f64::NAN;
                Some(RawReading::Ps(depth))
            }
            RawReading::Imu(_) => Some(reading),
            other if index.is_multiple_of(25) => held.replace(other),
            other => Some(other),
        }
    });
    let difference = hostile.score.rms_horizontal - clean.score.rms_horizontal;
    assert!(difference.abs() < 0.01, "{difference} m");
}

/// Any reading at all, with times that mostly run forward.
fn reading() -> impl Strategy<Value = (i64, u8, [f64; 6])> {
    let number = prop_oneof![
        8 => -20.0..20.0_f64,
        2 => -1e4..1e4_f64,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => -1e300..1e300_f64,
    ];
    (
        prop_oneof![20 => 0..20_000_000_i64, 1 => -2_000_000_000..4_000_000_000_i64],
        0..12_u8,
        [number.clone(), number.clone(), number.clone(), number.clone(), number.clone(), number],
    )
}

proptest! {
    #[test]
    fn no_stream_of_readings_makes_it_panic_or_publish_nan(
        stream in prop::collection::vec(reading(), 200..900),
        estimator in prop::sample::select(vec!["fgo", "fgo", "ekf", "fkf"]),
        reset in any::<bool>(),
    ) {
        let sets = [&format!("estimator={estimator}"), &format!("kalman.reset={reset}"), "frame.origin=[36.38, 127.36, 0.0]", "initial.position=[0.0, 0.0, -10.0]",
            "initial.velocity=[0.0, 0.0, 0.0]", "initial.quaternion=[1.0, 0.0, 0.0, 0.0]"];
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        let config = Config::load(&[], &sets).expect("valid");
        let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
        let mut t = 0_i64;
        for (step, kind, v) in stream {
            t += step;
            let header = Header::at(Time(t));
            let buoy = u32::from(kind % 4);
            let reading = match kind {
                0..6 => RawReading::Imu(ImuSample { header, gyro_body: [v[0] * 0.05, v[1] * 0.05, v[2] * 0.05],
                    accel_body: [v[3], v[4], 9.8 + v[5]] }),
                6 => RawReading::Lbl(LblRange { header, buoy, in_epoch: 0, range: 100.0 + v[0] }),
                7 => RawReading::Gnss(GnssFix { header, lat_deg: 36.38 + v[0] * 1e-6, lon_deg: 127.36 + v[1] * 1e-6,
                    height: v[2], sigma_enu: [v[3], v[4], v[5]] }),
                8 => RawReading::Dvl(DvlVelocity { header, velocity_dvl: [v[0], v[1], v[2]] }),
                9 => RawReading::Mcp(McpHeading { header, heading_deg: v[0] * 18.0 }),
                10 => RawReading::Ps(PsDepth { header, depth: v[0] }),
                _ => RawReading::Buoy(shared_types::BuoyFix { header, buoy, moored: u32::from(kind % 2), lat_deg: 36.38,
                    lon_deg: 127.36 + f64::from(buoy) * 1e-3, height: 0.0 }),
            };
            navigator.push(&reading, &mut Unmeasured, &mut |output| {
                if let Output::Estimate(estimate) = output {
                    assert_finite(estimate);
                }
            });
        }
    }
}

#[test]
fn a_heading_that_is_wrong_by_half_a_turn_is_found_without_a_compass() {
    // The right one turned about the vertical; the sigma says 0.5 deg.
    let turned = "initial.quaternion=[-0.7666956, -0.0002968, -0.0010039, 0.6420099]";
    let sets = ["mcp.enabled=false", "gnss.enabled=false", turned];
    let ran = Run { sets: &sets, until: 260.0, seed: 1, ..MISSION }.go();
    assert!(ran.solutions.iter().any(|s| s.status == SolutionStatus::Loosened as u32), "the state was suspected");
    for pair in ran.pairs.iter().filter(|pair| pair.estimate.t.as_seconds() > 230.0) {
        let error = pair.position_error_enu.xy().norm();
        assert!(error < 0.5, "{error} m at {}", pair.estimate.t);
    }
}
