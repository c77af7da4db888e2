//! A reading's walk through the whole preprocessor, rule by rule.
#![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]

mod readings;

use nav_preprocessing::Preprocessor;
use readings::{LAT_DEG, buoy, config, dvl, gnss, lbl, mcp, ps, raw_imu};
use shared_types::{
    AnchorMethod, Config, GnssFix, KeyframeCause, Measurement, RawReading, Reading, RejectReason, Sensor, Time,
};

/// What comes out beside the IMU samples: (sensor or keyframe, t_valid, t_keyframe), seconds.
type Row = (&'static str, f64, f64);

fn row(measurement: &Measurement) -> Row {
    let name = match measurement.sensor() {
        Some(sensor) => sensor.name(),
        None => match Reading::try_from(measurement).unwrap() {
            Reading::Keyframe { cause: KeyframeCause::Start } => "START",
            Reading::Keyframe { cause: KeyframeCause::Lbl } => "LBL",
            Reading::Keyframe { cause: KeyframeCause::Age } => "AGE",
            Reading::Keyframe { cause: KeyframeCause::ImuGap } => "GAP",
            other => panic!("{other:?}"),
        },
    };
    let seconds = |t: Time| t.to_string().parse().unwrap();
    (name, seconds(measurement.t_valid()), seconds(measurement.t_keyframe()))
}

/// Readings in the order of a log (by time, IMU first), with a 100 Hz IMU over each of `imu_spans`.
fn feed(preprocessor: &mut Preprocessor, imu_spans: &[(f64, f64)], aiding: &[RawReading]) -> Vec<Measurement> {
    let mut readings = Vec::new();
    for &(from, to) in imu_spans {
        let (from, to) = ((from * 100.0).round() as i64, (to * 100.0).round() as i64);
        readings.extend((from..=to).map(|step| raw_imu(step as f64 * 0.01)));
    }
    readings.extend_from_slice(aiding);
    readings.sort_by_key(|reading| (reading.t_valid(), reading.sensor() != Sensor::Imu));
    let mut out = Vec::new();
    for reading in &readings {
        preprocessor.push(reading, &mut |measurement| out.push(measurement));
    }
    out
}

fn aided_rows(out: &[Measurement]) -> Vec<Row> {
    out.iter().filter(|measurement| measurement.sensor() != Some(Sensor::Imu)).map(row).collect()
}

fn walk(config: &Config, imu_spans: &[(f64, f64)], aiding: &[RawReading]) -> (Vec<Row>, Preprocessor) {
    let mut preprocessor = Preprocessor::new(config);
    let out = feed(&mut preprocessor, imu_spans, aiding);
    (aided_rows(&out), preprocessor)
}

fn rejected(preprocessor: &Preprocessor, sensor: Sensor, reason: RejectReason) -> u64 {
    preprocessor.health()[sensor.index()].rejected[reason.index()]
}

#[test]
fn an_imu_sample_passes_at_once() {
    let mut preprocessor = Preprocessor::new(&config());
    let mut out = Vec::new();
    preprocessor.push(&raw_imu(1.0), &mut |measurement| out.push(measurement));
    assert_eq!(out.len(), 1);
    assert_eq!(Reading::try_from(&out[0]), Ok(Reading::Imu { gyro_body: [0.0; 3], accel_body: [0.0, 0.0, 9.8] }));
    assert_eq!(out[0].t_keyframe(), Time::from_seconds(1.0));
}

#[test]
fn a_measurement_carries_the_header_of_its_raw_reading() {
    let mut reading = dvl(0.5, 1.0);
    if let RawReading::Dvl(raw) = &mut reading {
        (raw.header.sequence, raw.header.epoch, raw.header.t_arrival) = (42, 3, 777);
    }
    let out = feed(&mut Preprocessor::new(&config()), &[(0.0, 2.0)], &[reading]);
    let header = out.iter().find(|measurement| measurement.sensor() == Some(Sensor::Dvl)).unwrap().header;
    assert_eq!((header.sequence, header.epoch, header.t_arrival, header.t_valid), (42, 3, 777, 500_000_000));
    assert_eq!((header.origin_sequence, header.origin_t_arrival), (42, 777));
}

#[test]
fn a_ping_comes_last_in_its_batch_and_the_keyframe_closes_it() {
    let aiding = [
        buoy(0.0, 1),
        buoy(0.0, 2),
        dvl(0.3, 1.0),
        ps(0.7, 1.0),
        lbl(1.0, 2, 50.0),
        lbl(1.0, 1, 40.0),
        dvl(1.0, 1.0),
        dvl(1.3, 1.0),
        lbl(2.0, 1, 40.0),
    ];
    let (rows, _) = walk(&config(), &[(0.0, 2.1)], &aiding);
    assert_eq!(
        rows,
        [
            ("START", 0.0, 0.0),
            ("dvl", 0.3, 0.0),
            ("ps", 0.7, 1.0),
            ("dvl", 1.0, 1.0),
            ("lbl", 1.0, 1.0),
            ("lbl", 1.0, 1.0),
            ("LBL", 1.0, 1.0),
            ("dvl", 1.3, 1.0),
            ("lbl", 2.0, 2.0),
            ("LBL", 2.0, 2.0),
        ]
    );
}

#[test]
fn ranges_of_one_instant_are_one_epoch() {
    let aiding = [buoy(0.0, 1), buoy(0.0, 2), lbl(1.0, 1, 40.0), lbl(1.0, 2, 50.0), lbl(2.0, 1, 40.0)];
    let out = feed(&mut Preprocessor::new(&config()), &[(0.0, 2.1)], &aiding);
    let epochs: Vec<_> = out.iter().filter(|m| m.sensor() == Some(Sensor::Lbl)).map(|m| m.epoch).collect();
    assert_eq!(epochs, [1, 1, 2]);
}

#[test]
fn without_pings_a_keyframe_comes_every_max_age() {
    let (rows, _) = walk(&config(), &[(0.0, 3.0)], &[]);
    assert_eq!(rows, [("START", 0.0, 0.0), ("AGE", 1.25, 1.25), ("AGE", 2.5, 2.5)]);
}

#[test]
fn a_ping_close_behind_a_keyframe_is_tied_to_it() {
    let (rows, _) = walk(&config(), &[(0.0, 2.6)], &[buoy(0.0, 1), lbl(1.4, 1, 40.0)]);
    assert_eq!(rows, [("START", 0.0, 0.0), ("AGE", 1.25, 1.25), ("lbl", 1.4, 1.25), ("AGE", 2.5, 2.5)]);
}

#[test]
fn the_start_may_lie_between_two_samples_and_the_one_before_it_is_kept() {
    let mut config = config();
    config.vehicle.initial.t = Some(Time::from_seconds(0.505));
    let mut preprocessor = Preprocessor::new(&config);
    let out = feed(&mut preprocessor, &[(0.0, 0.6)], &[ps(0.4, 1.0), ps(0.505, 1.0), ps(0.52, 1.0)]);
    assert_eq!(out[0].t_valid(), Time::from_seconds(0.5));
    assert_eq!(out[1].t_valid(), Time::from_seconds(0.51));
    assert_eq!(aided_rows(&out), [("ps", 0.505, 0.505), ("START", 0.505, 0.505)]);
    assert_eq!(rejected(&preprocessor, Sensor::Imu, RejectReason::BeforeStart), 50);
    assert_eq!(rejected(&preprocessor, Sensor::Ps, RejectReason::BeforeStart), 1);
}

#[test]
fn a_start_before_the_first_sample_is_the_first_sample() {
    let mut config = config();
    config.vehicle.initial.t = Some(Time::from_seconds(-5.0));
    let (rows, preprocessor) = walk(&config, &[(1.0, 1.2)], &[ps(0.5, 1.0)]);
    assert_eq!(rows, [("START", 1.0, 1.0)]);
    assert_eq!(rejected(&preprocessor, Sensor::Ps, RejectReason::BeforeStart), 1);
}

#[test]
fn without_an_attitude_what_came_before_the_start_is_let_through() {
    let mut config = config();
    config.vehicle.initial.q_enu_body = None;
    config.vehicle.initial.t = Some(Time::from_seconds(40.0));
    let mut preprocessor = Preprocessor::new(&config);
    let out = feed(&mut preprocessor, &[(0.0, 40.1)], &[mcp(5.0, 90.0), mcp(15.0, 90.0), ps(39.0, 1.0)]);
    assert_eq!(out[0].t_valid(), Time::from_seconds(10.0));
    assert_eq!(aided_rows(&out), [("mcp", 15.0, 40.0), ("ps", 39.0, 40.0), ("START", 40.0, 40.0)]);
    assert_eq!(rejected(&preprocessor, Sensor::Imu, RejectReason::BeforeStart), 1000);
    assert_eq!(rejected(&preprocessor, Sensor::Mcp, RejectReason::BeforeStart), 1);
}

#[test]
fn a_long_gap_ends_with_a_keyframe_and_its_readings_hold_to_either_end() {
    let aiding = [buoy(0.0, 1), dvl(1.5, 1.0), lbl(2.0, 1, 40.0), dvl(4.0, 1.0)];
    let (rows, _) = walk(&config(), &[(0.0, 1.0), (4.5, 4.6)], &aiding);
    assert_eq!(rows, [("START", 0.0, 0.0), ("dvl", 1.5, 0.0), ("lbl", 2.0, 0.0), ("dvl", 4.0, 4.5), ("GAP", 4.5, 4.5)]);
}

#[test]
fn a_short_gap_makes_no_keyframe() {
    let (rows, _) = walk(&config(), &[(0.0, 0.3), (0.7, 1.3)], &[]);
    assert_eq!(rows, [("START", 0.0, 0.0), ("AGE", 1.25, 1.25)]);
}

#[test]
fn a_late_reading_finds_its_keyframe_and_a_very_late_one_is_refused() {
    let mut config = config();
    config.navigator.fgo.window = 2;
    let mut preprocessor = Preprocessor::new(&config);
    feed(&mut preprocessor, &[(0.0, 4.0)], &[]);
    // Keyframes at 0, 1.25, 2.5, 3.75; the next at 5, and then 2.5 is the oldest.
    let mut rows = Vec::new();
    for reading in [dvl(0.1, 1.0), dvl(2.4, 1.0), dvl(3.0, 1.0), dvl(3.2, 1.0)] {
        preprocessor.push(&reading, &mut |measurement| rows.push(row(&measurement)));
    }
    assert_eq!(rows, [], "late readings wait for the next sample like all others");
    let out = feed(&mut preprocessor, &[(4.01, 5.1)], &[]);
    assert_eq!(aided_rows(&out), [("dvl", 3.0, 2.5), ("dvl", 3.2, 3.75), ("AGE", 5.0, 5.0)]);
    assert_eq!(rejected(&preprocessor, Sensor::Dvl, RejectReason::OlderThanWindow), 2);
}

#[test]
fn if_the_imu_stops_nothing_is_let_go() {
    let mut preprocessor = Preprocessor::new(&config());
    feed(&mut preprocessor, &[(0.0, 1.0)], &[]);
    for step in 0..100 {
        let reading = dvl(1.0 + f64::from(step) * 0.2, 1.0);
        preprocessor.push(&reading, &mut |measurement| panic!("{measurement:?}"));
    }
    assert_eq!(preprocessor.held(Sensor::Dvl), 100);
}

#[test]
fn a_reading_far_ahead_of_the_imu_has_no_imu() {
    let (_, preprocessor) = walk(&config(), &[(0.0, 1.0)], &[ps(70.0, 1.0)]);
    assert_eq!(rejected(&preprocessor, Sensor::Ps, RejectReason::NoImu), 1);
}

#[test]
fn a_finish_closes_what_the_imu_has_reached() {
    let mut preprocessor = Preprocessor::new(&config());
    feed(&mut preprocessor, &[(0.0, 0.5)], &[ps(0.4, 1.0), ps(0.49, 1.0), ps(0.51, 1.0)]);
    let mut rows = Vec::new();
    preprocessor.finish(&mut |measurement| rows.push(row(&measurement)));
    assert_eq!(rows, [("ps", 0.4, 0.5), ("ps", 0.49, 0.5), ("AGE", 0.5, 0.5)]);
    assert_eq!(rejected(&preprocessor, Sensor::Ps, RejectReason::NoImu), 1);
    assert_eq!(preprocessor.held(Sensor::Ps), 0);
}

#[test]
fn a_fix_while_deep_is_refused_and_the_one_at_the_surface_is_not() {
    let aiding = [ps(0.5, 8.0), gnss(0.6, 0.0), ps(0.65, 1.1), ps(0.7, 1.0), gnss(0.8, 0.0)];
    let (rows, preprocessor) = walk(&config(), &[(0.0, 1.5)], &aiding);
    assert_eq!(rejected(&preprocessor, Sensor::Gnss, RejectReason::WhileDeep), 1);
    assert_eq!(rows.iter().filter(|row| row.0 == "gnss").count(), 1);
}

#[test]
fn one_wild_depth_neither_refuses_a_good_fix_nor_lets_a_bad_one_in() {
    let surface = [ps(0.5, 0.4), ps(0.6, 0.4), ps(0.7, 8.0), gnss(0.75, 0.0), ps(0.8, 0.4)];
    let (_, preprocessor) = walk(&config(), &[(0.0, 1.5)], &surface);
    assert_eq!(rejected(&preprocessor, Sensor::Gnss, RejectReason::WhileDeep), 0);
    let deep = [ps(0.5, 8.0), ps(0.6, 8.0), ps(0.7, 0.4), gnss(0.75, 0.0), ps(0.8, 8.0)];
    let (_, preprocessor) = walk(&config(), &[(0.0, 1.5)], &deep);
    assert_eq!(rejected(&preprocessor, Sensor::Gnss, RejectReason::WhileDeep), 1);
}

#[test]
fn a_dead_pressure_sensor_does_not_refuse_satellites_for_ever() {
    let (_, preprocessor) = walk(&config(), &[(0.0, 20.0)], &[ps(0.5, 8.0), gnss(10.0, 0.0), gnss(11.0, 0.0)]);
    assert_eq!(rejected(&preprocessor, Sensor::Gnss, RejectReason::WhileDeep), 1);
}

#[test]
fn a_duplicate_is_dropped_even_when_it_comes_late() {
    let mut preprocessor = Preprocessor::new(&config());
    feed(&mut preprocessor, &[(0.0, 2.0)], &[dvl(0.5, 1.0), dvl(0.5, 1.0)]);
    let out = feed(&mut preprocessor, &[(2.01, 3.0)], &[dvl(0.5, 1.0)]);
    assert!(out.iter().all(|measurement| measurement.sensor() != Some(Sensor::Dvl)));
    assert_eq!(rejected(&preprocessor, Sensor::Dvl, RejectReason::Duplicate), 2);
}

#[test]
fn a_switched_off_sensor_is_counted_and_not_used() {
    let mut config = config();
    config.navigator.sensors[2].enabled = false;
    let (rows, preprocessor) = walk(&config, &[(0.0, 1.0)], &[dvl(0.5, 1.0)]);
    assert_eq!(rows, [("START", 0.0, 0.0)]);
    assert_eq!(rejected(&preprocessor, Sensor::Dvl, RejectReason::Disabled), 1);
}

#[test]
fn a_range_to_an_unheard_buoy_makes_no_keyframe() {
    let (rows, preprocessor) = walk(&config(), &[(0.0, 1.2)], &[lbl(1.0, 9, 40.0)]);
    assert_eq!(rows, [("START", 0.0, 0.0)]);
    assert_eq!(rejected(&preprocessor, Sensor::Lbl, RejectReason::UnknownBuoy), 1);
}

#[test]
fn the_first_fix_places_the_frame_and_ranges_before_it_are_too_early() {
    let mut config = config();
    config.vehicle.frame.origin_geodetic = None;
    let mut preprocessor = Preprocessor::new(&config);
    let aiding = [buoy(0.0, 1), lbl(0.4, 1, 40.0), gnss(0.5, 0.0), gnss(0.6, 1e-5), lbl(0.7, 1, 40.0)];
    let out = feed(&mut preprocessor, &[(0.0, 1.0)], &aiding);
    let origin = preprocessor.origin().unwrap();
    assert_eq!((origin.lat_deg, origin.header.t_valid), (LAT_DEG, 500_000_000));
    assert_eq!(rejected(&preprocessor, Sensor::Lbl, RejectReason::BeforeStart), 1);
    let antennas: Vec<_> = out
        .iter()
        .filter_map(|measurement| match Reading::try_from(measurement) {
            Ok(Reading::Gnss { antenna_enu, .. }) => Some(antenna_enu),
            _ => None,
        })
        .collect();
    assert_eq!(antennas[0], [0.0; 3]);
    // 1e-5 deg of the meridian at 36 deg: M = 6 357 466 m.
    assert!((antennas[1][1] - 1.1096).abs() < 1e-4, "{antennas:?}");
}

#[test]
fn a_switched_off_receiver_still_places_the_frame() {
    let mut config = config();
    config.vehicle.frame.origin_geodetic = None;
    config.navigator.sensors[1].enabled = false;
    let (_, preprocessor) = walk(&config, &[(0.0, 1.0)], &[gnss(0.5, 0.0)]);
    assert_eq!(preprocessor.origin().map(|origin| origin.lat_deg), Some(LAT_DEG));
    assert_eq!(rejected(&preprocessor, Sensor::Gnss, RejectReason::Disabled), 1);
}

#[test]
fn a_restart_cannot_move_the_frame() {
    let mut config = config();
    config.vehicle.frame.origin_geodetic = None;
    let (_, first) = walk(&config, &[(0.0, 1.0)], &[gnss(0.5, 0.0)]);
    let mut restarted = Preprocessor::new(&config).with_origin(first.origin().unwrap()).unwrap();
    feed(&mut restarted, &[(2.0, 3.0)], &[gnss(2.5, 1e-3)]);
    assert_eq!(restarted.origin(), first.origin());
}

#[test]
fn an_impossible_sigma_is_replaced_and_counted() {
    let RawReading::Gnss(fix) = gnss(0.5, 0.0) else { panic!() };
    let bad = RawReading::Gnss(GnssFix { sigma_enu: [0.0, 1.0, 1.0], ..fix });
    let (rows, preprocessor) = walk(&config(), &[(0.0, 1.5)], &[bad]);
    assert_eq!(rows[1].0, "gnss");
    assert_eq!(preprocessor.sigmas_substituted(), 1);
}

#[test]
fn known_tracks_reach_both_ways_where_live_fixes_only_carry_on() {
    let drifting = |t: f64, dlat: f64| {
        let RawReading::Buoy(fix) = buoy(t, 1) else { panic!() };
        shared_types::BuoyFix { moored: 0, lat_deg: LAT_DEG + dlat, ..fix }
    };
    let fixes = [drifting(0.0, 0.0), drifting(1.0, 0.0), drifting(3.0, 2e-5)];
    let aiding: Vec<_> = fixes.iter().copied().map(RawReading::Buoy).chain([lbl(2.0, 1, 40.0)]).collect();
    let north = |preprocessor: &mut Preprocessor| {
        let out = feed(preprocessor, &[(0.0, 4.0)], &aiding);
        let range = out.iter().find(|measurement| measurement.sensor() == Some(Sensor::Lbl)).unwrap();
        match Reading::try_from(range).unwrap() {
            Reading::Lbl { buoy_enu, .. } => buoy_enu[1],
            other => panic!("{other:?}"),
        }
    };
    let live = north(&mut Preprocessor::new(&config()));
    let known = north(&mut Preprocessor::new(&config()).with_known_buoys(fixes.to_vec()));
    assert_eq!(live, 0.0);
    assert!((known - 1.1096).abs() < 1e-4, "{known}");
}

#[test]
fn a_filter_hears_of_each_reading_before_the_bracket_of_its_keyframe() {
    let mut config = config();
    config.navigator.keyframes.anchor = AnchorMethod::AtOnce;
    let mut preprocessor = Preprocessor::new(&config);
    let out = feed(&mut preprocessor, &[(0.0, 1.5)], &[ps(0.3, 1.0), ps(1.0, 1.0), ps(1.4, 1.0)]);
    let at = |t: f64| out.iter().position(|m| m.sensor() == Some(Sensor::Imu) && m.t_valid() == Time::from_seconds(t));
    let first = out.iter().position(|m| m.sensor() == Some(Sensor::Ps)).unwrap();
    assert!(first < at(0.4).unwrap(), "it waits for the settle time alone");
    let bracketed = [("START", 0.0, 0.0), ("ps", 0.3, 0.3), ("ps", 1.0, 1.0), ("AGE", 1.25, 1.25), ("ps", 1.4, 1.4)];
    assert_eq!(aided_rows(&out), bracketed);
    let mut rest = Vec::new();
    preprocessor.finish(&mut |m| rest.push(m));
    assert_eq!(aided_rows(&rest), [("AGE", 1.5, 1.5)], "the last reading gets its bracket");
}

#[test]
fn position_focused_readings_are_dated_to_their_keyframe() {
    let mut config = config();
    config.navigator.keyframes.anchor = AnchorMethod::Pf;
    let (rows, _) = walk(&config, &[(0.0, 1.5)], &[ps(0.3, 1.0), ps(1.0, 1.0)]);
    assert_eq!(rows, [("START", 0.0, 0.0), ("ps", 0.0, 0.0), ("ps", 1.25, 1.25), ("AGE", 1.25, 1.25)]);
}
