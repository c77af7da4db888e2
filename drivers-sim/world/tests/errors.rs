//! The errors of the sensors are what they are said to be, and come from the seed and the sensor alone.

use shared_types::{Config, ConfigText, ImuSample, RawReading, Time};
use sim_world::{Preset, Scenario, World};

fn scenario(name: &str) -> Scenario {
    Scenario::builtin(name).expect("it is built in")
}

fn world(scenario: &Scenario, preset: Preset, seed: u64) -> World {
    World::new(scenario, preset, seed).expect("it is valid")
}

/// Standard deviation about zero.
fn deviation(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Four sigmas of the sampling error of a standard deviation, relative.
fn tolerance(count: usize) -> f64 {
    4.0 / (2.0 * count as f64).sqrt()
}

fn assert_deviation(what: &str, errors: &[f64], sigma: f64) {
    assert!(errors.len() > 100, "{what}: {} readings", errors.len());
    let ratio = deviation(errors) / sigma;
    eprintln!("{what}: {} readings, deviation / sigma = {ratio:.4}", errors.len());
    assert!((ratio - 1.0).abs() < tolerance(errors.len()), "{what}: deviation is {ratio} times its sigma");
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(mean.abs() < 4.0 * sigma / (errors.len() as f64).sqrt(), "{what}: mean is {mean}, sigma {sigma}");
}

#[test]
fn the_deviation_of_every_aiding_sensor_is_its_sigma() {
    let mission = scenario("mission");
    let (noisy, exact) = (world(&mission, Preset::Paper, 5), world(&mission, Preset::None, 5));
    let lbl: Vec<f64> = noisy.lbl().zip(exact.lbl()).map(|(a, b)| a.range - b.range).collect();
    assert_deviation("lbl", &lbl, 0.3);
    let ps: Vec<f64> = noisy.ps().zip(exact.ps()).map(|(a, b)| a.depth - b.depth).collect();
    assert_deviation("ps", &ps, 0.01);
    let wrap = |degrees: f64| (degrees + 180.0).rem_euclid(360.0) - 180.0;
    let mcp: Vec<f64> = noisy.mcp().zip(exact.mcp()).map(|(a, b)| wrap(a.heading_deg - b.heading_deg)).collect();
    assert_deviation("mcp", &mcp, 0.01);
    for axis in 0..3 {
        let dvl = noisy.dvl().zip(exact.dvl()).map(|(a, b)| a.velocity_dvl[axis] - b.velocity_dvl[axis]);
        assert_deviation("dvl", &dvl.collect::<Vec<f64>>(), 0.01);
    }
    // Metres per degree of longitude and latitude at 36.38 degrees, good to a thousandth.
    let metres = [89_705.0, 110_970.0];
    let east = noisy.gnss().zip(exact.gnss()).map(|(a, b)| (a.lon_deg - b.lon_deg) * metres[0]);
    assert_deviation("gnss east", &east.collect::<Vec<f64>>(), 0.02);
    let north = noisy.gnss().zip(exact.gnss()).map(|(a, b)| (a.lat_deg - b.lat_deg) * metres[1]);
    assert_deviation("gnss north", &north.collect::<Vec<f64>>(), 0.02);
    let up = noisy.gnss().zip(exact.gnss()).map(|(a, b)| a.height - b.height);
    assert_deviation("gnss up", &up.collect::<Vec<f64>>(), 0.01);
}

#[test]
fn the_white_noise_of_the_imu_is_its_density_times_the_root_of_the_rate() {
    let stable = scenario("stable");
    for (preset, accel_density) in [(Preset::Paper, 9.80665e-7), (Preset::Realistic, 1e-3)] {
        let (noisy, exact) = (world(&stable, preset, 5), world(&stable, Preset::None, 5));
        let errors: Vec<[f64; 2]> = noisy
            .imu()
            .zip(exact.imu())
            .map(|(a, b)| [a.gyro_body[1] - b.gyro_body[1], a.accel_body[2] - b.accel_body[2]])
            .collect();
        // Differences of neighbours: the bias falls out; pairs that share no sample are independent.
        for (index, density) in [2.908_88e-5, accel_density].into_iter().enumerate() {
            let differences: Vec<f64> = errors.chunks_exact(2).map(|pair| pair[1][index] - pair[0][index]).collect();
            let walk = [1e-7_f64, 1e-6][index] * (1.0_f64 / 200.0).sqrt();
            let white = density * 200.0_f64.sqrt() * 2.0_f64.sqrt();
            assert_deviation("imu", &differences, white.hypot(walk));
        }
    }
}

#[test]
fn turn_on_biases_are_drawn_anew_for_every_seed() {
    let stable = scenario("stable");
    let truth = world(&stable, Preset::None, 0).imu().next().expect("it has an IMU");
    let firsts: Vec<ImuSample> =
        (0..300).map(|seed| world(&stable, Preset::Paper, seed).imu().next().expect("it has an IMU")).collect();
    for axis in 0..3 {
        let gyro: Vec<f64> = firsts.iter().map(|first| first.gyro_body[axis] - truth.gyro_body[axis]).collect();
        assert_deviation("gyro bias", &gyro, 1.21203e-4_f64.hypot(2.90888e-5 * 200.0_f64.sqrt()));
        let accel: Vec<f64> = firsts.iter().map(|first| first.accel_body[axis] - truth.accel_body[axis]).collect();
        assert_deviation("accel bias", &accel, 9.80665e-4);
    }
}

#[test]
fn the_same_seed_repeats_to_the_bit_and_another_does_not() {
    let outage = scenario("outage");
    let first: Vec<RawReading> = world(&outage, Preset::Realistic, 3).readings().take(100_000).collect();
    let again: Vec<RawReading> = world(&outage, Preset::Realistic, 3).readings().take(100_000).collect();
    assert!(first == again);
    let other: Vec<RawReading> = world(&outage, Preset::Realistic, 4).readings().take(100_000).collect();
    let moored = |reading: &RawReading| matches!(reading, RawReading::Buoy(_));
    assert!(first.iter().zip(&other).all(|(a, b)| moored(a) || a != b));
    assert_ne!(
        world(&outage, Preset::Realistic, 3).sensors_toml(),
        world(&outage, Preset::Realistic, 4).sensors_toml()
    );
}

#[test]
fn switching_a_sensor_off_or_giving_it_an_outage_changes_no_other_reading() {
    let whole = scenario("mission");
    let mut without = whole.clone();
    without.dvl = None;
    without.imu = None;
    let (all, some) = (world(&whole, Preset::Paper, 2), world(&without, Preset::Paper, 2));
    assert_eq!(some.dvl().count() + some.imu().count(), 0);
    assert!(
        all.lbl().eq(some.lbl()) && all.gnss().eq(some.gnss()) && all.mcp().eq(some.mcp()) && all.ps().eq(some.ps())
    );

    let mut silent = whole.clone();
    let span = [Time::from_seconds(100.0), Time::from_seconds(200.0)];
    silent.lbl.as_mut().expect("it is fitted").schedule.outages = vec![span];
    let outside = |t: i64| t < span[0].0 || t > span[1].0;
    let kept = all.lbl().filter(|range| outside(range.header.t_valid)).map(|range| (range.header.t_valid, range.range));
    let silenced = world(&silent, Preset::Paper, 2);
    assert!(silenced.lbl().map(|range| (range.header.t_valid, range.range)).eq(kept));
    assert!(silenced.lbl().enumerate().all(|(index, range)| range.header.sequence == index as u64));
}

#[test]
fn dropouts_and_outliers_come_as_often_and_as_large_as_asked() {
    let mut rough = scenario("mission");
    let lbl = rough.lbl.as_mut().expect("it is fitted");
    (lbl.schedule.dropout, lbl.schedule.outlier_probability, lbl.schedule.outlier_size) = (0.1, 0.05, 20.0);
    let world = world(&rough, Preset::Paper, 1);
    let ranges: Vec<_> = world.lbl().collect();
    let asked = 2217.0 * 4.0;
    let share = ranges.len() as f64 / asked;
    assert!((share - 0.9).abs() < 4.0 * (0.09_f64 / asked).sqrt(), "{share} of the ranges came");
    for epoch in ranges.chunk_by(|a, b| a.header.t_valid == b.header.t_valid) {
        assert!(epoch.iter().all(|range| range.in_epoch as usize == epoch.len()));
    }
    let mut calm = rough.clone();
    calm.lbl.as_mut().expect("it is fitted").schedule.outlier_probability = 0.0;
    let calm = World::new(&calm, Preset::Paper, 1).expect("it is valid");
    let wild: Vec<f64> = ranges.iter().zip(calm.lbl()).map(|(a, b)| a.range - b.range).filter(|e| *e != 0.0).collect();
    let share = wild.len() as f64 / ranges.len() as f64;
    assert!((share - 0.05).abs() < 4.0 * (0.05_f64 * 0.95 / ranges.len() as f64).sqrt(), "{share} are wild");
    assert!(wild.iter().all(|error| (9.99..=30.01).contains(error)), "{wild:?}");
}

#[test]
fn a_late_clock_shifts_the_stamps_and_nothing_else() {
    let punctual = scenario("stable");
    let mut late = punctual.clone();
    late.dvl.as_mut().expect("it is fitted").schedule.clock_offset = shared_types::Duration(30_000_000);
    let (punctual, late) = (world(&punctual, Preset::Paper, 1), world(&late, Preset::Paper, 1));
    for (a, b) in punctual.dvl().zip(late.dvl()) {
        assert_eq!(a.velocity_dvl, b.velocity_dvl);
        assert_eq!(b.header.t_valid - a.header.t_valid, 30_000_000);
    }
}

#[test]
fn sensors_toml_is_a_valid_configuration_and_states_the_noise() {
    for (name, _) in sim_world::BUILTIN_SCENARIOS {
        let scenario = scenario(name);
        for (_, preset) in Preset::ALL {
            let world = world(&scenario, preset, 9);
            let text = ConfigText { file: "sensors.toml".into(), text: world.sensors_toml() };
            let vehicle = Config::load(&[text], &[]).unwrap_or_else(|error| panic!("{name}: {error}")).vehicle;
            // The navigator believes no accelerometer to be better than 1 µg/√Hz.
            assert_eq!(vehicle.imu.accel_noise_density, preset.noise().accel_noise_density.max(1e-5));
            assert_eq!(vehicle.lbl.sigma, 0.3);
            assert_eq!(vehicle.dvl.mounting_rpy[2], 3.0_f64.to_radians());
            assert_eq!(vehicle.initial.t, Some(Time::from_seconds(17.0)));
            let position = vehicle.initial.position_enu.expect("it is given");
            let truth = world.motion(Time::from_seconds(17.0)).position_enu;
            if preset == Preset::None {
                assert_eq!(position, <[f64; 3]>::from(truth));
            } else {
                let error: Vec<f64> = (0..3).map(|axis| position[axis] - truth[axis]).collect();
                assert!(
                    error.iter().all(|e| *e != 0.0 && e.abs() < 5.0 * scenario.initial.sigma_position),
                    "{error:?}"
                );
            }
        }
    }
}
