//! Whatever comes in: no panic, no number that is none, and every reading accounted for.

mod readings;

use nav_preprocessing::Preprocessor;
use proptest::prelude::*;
use readings::{buoy, config, dvl, gnss, lbl, mcp, ps, raw_imu};
use shared_types::{Config, Measurement, RawReading, Reading, SENSORS, Sensor};

/// Any `f64` there is, the awkward ones often.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -200.0..200.0_f64,
        1 => any::<f64>(),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(0.0), Just(-0.0)],
    ]
}

/// Mostly the first minute, sometimes anything.
fn any_time() -> impl Strategy<Value = i64> {
    prop_oneof![
        12 => 0..60_000_000_000_i64,
        4 => (0..60_i64).prop_map(|t| t * 1_000_000_000),
        1 => any::<i64>(),
        1 => prop_oneof![Just(i64::MIN), Just(i64::MAX), Just(0)],
    ]
}

/// A reading with everything but its kind drawn at random.
fn any_reading() -> impl Strategy<Value = RawReading> {
    (0..12_u32, any_time(), prop::array::uniform6(any_number()), 0..5_u32, any::<bool>()).prop_map(
        |(kind, t, numbers, number, flag)| {
            let [a, b, c, d, e, f] = numbers;
            let mut reading = match kind {
                0 => buoy(0.0, number),
                1 => gnss(0.0, 0.0),
                2 => dvl(0.0, a),
                3 => mcp(0.0, a),
                4 => ps(0.0, a),
                5 | 6 => lbl(0.0, number, a),
                _ => raw_imu(0.0),
            };
            match &mut reading {
                RawReading::Imu(r) => {
                    r.header.t_valid = t;
                    (r.gyro_body, r.accel_body) =
                        if flag { ([0.0; 3], [0.0, 0.0, 9.8]) } else { ([a, b, c], [d, e, f]) };
                }
                RawReading::Buoy(r) => {
                    (r.header.t_valid, r.moored) = (t, u32::from(flag));
                    (r.lat_deg, r.lon_deg, r.height) = (a, b, c);
                }
                RawReading::Gnss(r) => {
                    r.header.t_valid = t;
                    (r.lat_deg, r.lon_deg, r.height, r.sigma_enu) = (a, b, c, [d, e, f]);
                }
                RawReading::Dvl(r) => (r.header.t_valid, r.velocity_dvl) = (t, [a, b, c]),
                RawReading::Mcp(r) => r.header.t_valid = t,
                RawReading::Ps(r) => r.header.t_valid = t,
                RawReading::Lbl(r) => r.header.t_valid = t,
            }
            reading
        },
    )
}

/// Good IMU samples over a minute at 10 Hz, so that time goes on between the wild readings.
fn with_a_sound_imu(wild: Vec<RawReading>) -> Vec<RawReading> {
    let mut readings: Vec<_> = (0..600).map(|step| raw_imu(f64::from(step) * 0.1)).collect();
    let stride = readings.len() / wild.len().max(1);
    for (index, reading) in wild.into_iter().enumerate() {
        readings.insert((index * (stride + 1)).min(readings.len()), reading);
    }
    readings
}

fn any_config() -> impl Strategy<Value = Config> {
    (any::<bool>(), any::<bool>(), prop::option::of(-10.0..70.0_f64), prop::array::uniform5(any::<bool>())).prop_map(
        |(has_origin, has_attitude, t_start, enabled)| {
            let mut config = config();
            if !has_origin {
                config.vehicle.frame.origin_geodetic = None;
            }
            if !has_attitude {
                config.vehicle.initial.q_enu_body = None;
            }
            config.vehicle.initial.t = t_start.map(shared_types::Time::from_seconds);
            for (sensor, enabled) in config.navigator.sensors.iter_mut().zip(enabled) {
                sensor.enabled = enabled;
            }
            config
        },
    )
}

/// Runs everything through, and checks the measurements and the accounts as they come.
fn run(config: &Config, readings: &[RawReading]) -> Result<(), TestCaseError> {
    let mut preprocessor = Preprocessor::new(config);
    let mut emitted = [0_u64; SENSORS.len()];
    let mut problem = None;
    let mut take = |measurement: Measurement| {
        if let Some(sensor) = measurement.sensor() {
            emitted[sensor.index()] += 1;
        }
        let checked = Reading::try_from(&measurement);
        let may_be_infinite = if matches!(checked, Ok(Reading::Gnss { .. })) { 3..6 } else { 0..0 };
        for (index, value) in measurement.values.iter().enumerate() {
            if !(value.is_finite() || may_be_infinite.contains(&index) && *value == f64::INFINITY) {
                problem = Some(format!("{measurement:?}"));
            }
        }
        if let Err(error) = checked {
            problem = Some(format!("{error}: {measurement:?}"));
        }
    };
    for reading in readings {
        preprocessor.push(reading, &mut take);
    }
    let held: u64 = SENSORS.iter().map(|&sensor| preprocessor.held(sensor) as u64).sum();
    let received: u64 = preprocessor.health().iter().map(|health| health.received).sum();
    prop_assert_eq!(received, readings.len() as u64);
    let rejected: u64 = preprocessor.health().iter().flat_map(|health| health.rejected).sum();
    prop_assert!(held + rejected <= received);
    preprocessor.finish(&mut take);
    prop_assert_eq!(problem, None);
    for sensor in SENSORS {
        let health = &preprocessor.health()[sensor.index()];
        let rejected: u64 = health.rejected.iter().sum();
        prop_assert_eq!(preprocessor.held(sensor), 0);
        let accounted = emitted[sensor.index()] + rejected;
        if sensor == Sensor::Buoys {
            prop_assert!(accounted <= health.received, "an accepted buoy position goes into the tracks");
        } else {
            prop_assert_eq!(accounted, health.received, "{} {:?}", sensor, health);
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases.max(400)))]

    #[test]
    fn arbitrary_readings_are_survived_and_accounted_for(
        config in any_config(),
        readings in prop::collection::vec(any_reading(), 0..300),
    ) {
        run(&config, &readings)?;
    }

    #[test]
    fn wild_readings_among_a_sound_imu_are_survived_and_accounted_for(
        config in any_config(),
        wild in prop::collection::vec(any_reading(), 0..300),
    ) {
        run(&config, &with_a_sound_imu(wild))?;
    }
}

#[test]
fn readings_held_in_the_middle_of_a_run_are_accounted_for() {
    let mut preprocessor = Preprocessor::new(&config());
    let mut emitted = 0;
    for step in 0..500 {
        let t = f64::from(step) * 0.01;
        for reading in [raw_imu(t), dvl(t, 1.0)] {
            preprocessor.push(&reading, &mut |m| emitted += usize::from(m.sensor() == Some(Sensor::Dvl)));
        }
        assert_eq!(emitted + preprocessor.held(Sensor::Dvl), step as usize + 1);
    }
}
