//! Every class from outside: what it does, how often, and that it keeps to its span, its sensor and its seed.

use shared_types::{
    BuoyFix, DvlVelocity, GnssFix, Header, ImuSample, LblRange, McpHeading, PsDepth, RawReading, SENSORS, Sensor, Time,
};
use sim_faults::{ArrivalClock, FaultSpec, FaultStream, class_table};

const BUOYS: u32 = 4;

/// Everything a vehicle reads in `seconds`: IMU at 100 Hz, four ranges and a fix a second, the rest at 10 Hz.
fn vehicle(seconds: u32) -> Vec<RawReading> {
    let mut readings = Vec::new();
    for buoy in 1..=BUOYS {
        let header = Header::at(Time(0));
        readings.push(RawReading::Buoy(BuoyFix {
            header,
            buoy,
            moored: 1,
            lat_deg: 36.0,
            lon_deg: 127.0,
            height: 0.0,
        }));
    }
    for step in 0..seconds * 100 {
        let t = f64::from(step) * 0.01;
        let header = Header::at(Time::from_seconds(t));
        let (gyro_body, accel_body) = ([0.01, -0.02, 0.03], [0.1, -0.2, 9.8 + 0.1 * t.sin()]);
        readings.push(RawReading::Imu(ImuSample { header, gyro_body, accel_body }));
        if step % 10 == 1 {
            readings.push(RawReading::Dvl(DvlVelocity { header, velocity_dvl: [1.0, 0.1, t * 1e-3] }));
            readings.push(RawReading::Mcp(McpHeading { header, heading_deg: (350.0 + t).rem_euclid(360.0) }));
            readings.push(RawReading::Ps(PsDepth { header, depth: 5.0 + 0.01 * t }));
        }
        if step % 100 == 50 {
            let sigma_enu = [0.02; 3];
            readings.push(RawReading::Gnss(GnssFix { header, lat_deg: 36.0, lon_deg: 127.0, height: 3.0, sigma_enu }));
            for buoy in 1..=BUOYS {
                readings.push(RawReading::Lbl(LblRange { header, buoy, in_epoch: BUOYS, range: 400.0 + t }));
            }
        }
    }
    readings
}

fn through(specs: &[&str], seed: u64, source: &[RawReading]) -> Vec<RawReading> {
    let specs: Vec<FaultSpec> = specs.iter().map(|spec| spec.parse().expect("a fault")).collect();
    let stream = FaultStream::new(&specs, seed, ArrivalClock::Valid);
    stream.over(source.iter().copied().map(Ok::<_, ()>)).map(|reading| reading.expect("no error")).collect()
}

fn of(sensor: Sensor, readings: &[RawReading]) -> Vec<RawReading> {
    readings.iter().copied().filter(|reading| reading.sensor() == sensor).collect()
}

/// Bits, so that NaN equals itself.
fn text(readings: &[RawReading]) -> Vec<String> {
    readings.iter().map(|reading| format!("{reading:?}")).collect()
}

fn ranges(readings: &[RawReading]) -> Vec<LblRange> {
    readings.iter().filter_map(|r| if let RawReading::Lbl(range) = r { Some(*range) } else { None }).collect()
}

fn depths(readings: &[RawReading]) -> Vec<(f64, f64)> {
    readings
        .iter()
        .filter_map(|r| if let RawReading::Ps(ps) = r { Some((r.t_valid().as_seconds(), ps.depth)) } else { None })
        .collect()
}

/// Within four sigmas of a binomial share.
fn assert_share(count: usize, of: usize, share: f64, what: &str) {
    let sigma = (share * (1.0 - share) / of as f64).sqrt();
    let found = count as f64 / of as f64;
    assert!((found - share).abs() <= 4.0 * sigma, "{what}: {found} instead of {share} of {of}");
}

/// Sensor and class of every row of the table.
fn every_class() -> Vec<(Sensor, String)> {
    let mut all = Vec::new();
    for line in class_table().lines().skip(2) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let class = cells[2].trim_matches('`').to_owned();
        match cells[1] {
            "any" => all.extend(SENSORS.map(|sensor| (sensor, class.clone()))),
            names => all.extend(
                names.split(' ').map(|name| (Sensor::from_name(name).expect("the table names sensors"), class.clone())),
            ),
        }
    }
    all
}

#[test]
fn without_faults_every_reading_passes_in_its_order() {
    let source = vehicle(5);
    let passed = through(&[], 1, &source);
    assert_eq!(passed.len(), source.len());
    for (before, after) in source.iter().zip(&passed) {
        assert_eq!((before.sensor(), before.t_valid()), (after.sensor(), after.t_valid()));
        assert_eq!(after.header().t_arrival, after.header().t_valid);
    }
}

#[test]
fn every_class_keeps_to_its_span_its_sensor_and_its_seed() {
    let source = vehicle(40);
    let untouched = through(&[], 1, &source);
    for (sensor, class) in every_class() {
        // A moored buoy speaks once, at the start.
        let (from, to) = if sensor == Sensor::Buoys { (0.0, 20.0) } else { (10.0, 20.0) };
        let spec = format!("{}.{class}@{from}..{to}", sensor.name());
        let faulty = through(&[&spec], 7, &source);
        assert_eq!(text(&faulty), text(&through(&[&spec], 7, &source)), "{spec}: twice the same seed");
        for other in SENSORS.into_iter().filter(|other| *other != sensor) {
            assert_eq!(text(&of(other, &faulty)), text(&of(other, &untouched)), "{spec} changed {other}");
        }
        let outside = |readings: &[RawReading]| {
            let far = readings.iter().filter(|r| {
                let arrival = Time(r.header().t_arrival).as_seconds();
                // What was read within the span may arrive after it.
                !(from..to).contains(&arrival) && r.t_valid().0 == r.header().t_arrival
            });
            text(&far.copied().collect::<Vec<RawReading>>())
        };
        assert_eq!(outside(&of(sensor, &faulty)), outside(&of(sensor, &untouched)), "{spec} acted outside its span");
        // In a stream of its own the sensor fails as in that of all.
        assert_eq!(text(&through(&[&spec], 7, &of(sensor, &source))), text(&of(sensor, &faulty)), "{spec} alone");
        let arrivals: Vec<i64> = faulty.iter().map(|r| r.header().t_arrival).collect();
        assert!(arrivals.is_sorted(), "{spec}: out of the order of arrival");
    }
}

#[test]
fn every_class_acts_somewhere() {
    let source = vehicle(300);
    for (sensor, class) in every_class() {
        // What the table's defaults are for: a counter of 71 minutes, rails of a vehicle in a turn.
        let values = match (sensor, class.as_str()) {
            (Sensor::Imu, "saturate") => "=0.025",
            (Sensor::Buoys, "nan" | "inf" | "huge" | "duplicate" | "out_of_order" | "dropout") => "=1",
            // A buoy that has spoken once cannot freeze or drift.
            (Sensor::Buoys, "stuck" | "stamp_ramp" | "stamp_wrap") => continue,
            (_, "stamp_wrap") => "=60",
            _ => "",
        };
        let spec: FaultSpec = format!("{}.{class}{values}", sensor.name()).parse().expect("a fault");
        let mut stream = FaultStream::new(std::slice::from_ref(&spec), 3, ArrivalClock::Valid);
        source.iter().for_each(|reading| stream.push(*reading));
        stream.finish();
        while stream.pop().is_some() {}
        let (_, tally) = stream.tallies().next().expect("one fault");
        assert_eq!(tally.seen as usize, of(sensor, &source).len(), "{spec}");
        assert!(tally.touched + tally.lost + tally.repeated > 0, "{spec}: {tally:?}");
    }
}

#[test]
fn seeds_differ_and_a_second_fault_changes_nothing_of_the_first() {
    let source = vehicle(100);
    let one = through(&["ps.spikes=0.2,5"], 1, &source);
    assert_ne!(text(&one), text(&through(&["ps.spikes=0.2,5"], 2, &source)));
    let both = through(&["dvl.spikes=0.5", "ps.spikes=0.2,5", "lbl.multipath"], 1, &source);
    assert_eq!(depths(&both), depths(&one));
}

#[test]
fn multipath_lengthens_its_share_by_its_extent() {
    let source = vehicle(2000);
    let faulty = ranges(&through(&["lbl.multipath=0.2,5,300"], 1, &source));
    let excess: Vec<f64> =
        faulty.iter().zip(ranges(&source)).map(|(a, b)| a.range - b.range).filter(|x| *x != 0.0).collect();
    assert_share(excess.len(), faulty.len(), 0.2, "multipath");
    assert!(excess.iter().all(|x| (5.0..=300.0).contains(x)));
    let mean = excess.iter().sum::<f64>() / excess.len() as f64;
    // Uniform: sigma of the mean is (300 - 5) / √12 / √n.
    assert!((mean - 152.5).abs() < 4.0 * 295.0 / 12.0_f64.sqrt() / (excess.len() as f64).sqrt(), "{mean}");
}

#[test]
fn bursts_and_clusters_are_runs_of_their_length_and_share() {
    let source = vehicle(6000);
    for class in ["bursts", "clusters"] {
        let faulty = ranges(&through(&[&format!("lbl.{class}=0.2,20,5,300")], 1, &source));
        let clean = ranges(&source);
        let (mut wrong, mut total, mut spreads) = (0, 0, Vec::new());
        for buoy in 1..=BUOYS {
            let excess: Vec<f64> =
                faulty.iter().zip(&clean).filter(|(a, _)| a.buoy == buoy).map(|(a, b)| a.range - b.range).collect();
            let runs: Vec<&[f64]> = excess.split(|x| *x == 0.0).filter(|run| !run.is_empty()).collect();
            for run in &runs[..runs.len() - 1] {
                // Two runs may follow each other without a good range between.
                assert_eq!(run.len() % 20, 0, "{class}: a run of {}", run.len());
                let (least, most) = run[..20].iter().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
                spreads.push(most - least);
            }
            wrong += runs.iter().map(|run| run.len()).sum::<usize>();
            total += excess.len();
        }
        let share = wrong as f64 / total as f64;
        // Some 240 runs: the share scatters by a fifteenth.
        assert!((share - 0.2).abs() < 0.05, "{class}: {share}");
        let wide = spreads.iter().filter(|spread| **spread > 3.0).count();
        assert_eq!(wide, if class == "bursts" { spreads.len() } else { 0 }, "{class}");
    }
}

#[test]
fn losses_gaps_and_duplicates_have_their_shares() {
    let source = vehicle(1000);
    let all = depths(&source).len();
    assert_share(all - depths(&through(&["ps.dropout=0.3"], 1, &source)).len(), all, 0.3, "dropout");
    let repeated = depths(&through(&["ps.duplicate=0.1,0.35"], 1, &source));
    assert_share(repeated.len() - all, all, 0.1, "duplicate");
    let gapped = depths(&through(&["ps.gaps=1,10@20..40"], 1, &source));
    assert_eq!(all - gapped.len(), 20, "two gaps of a second");
    assert!(gapped.iter().all(|(t, _)| !(20.0..21.0).contains(t) && !(30.0..31.0).contains(t)));
    let quiet = ranges(&through(&["lbl.silent=3"], 1, &source));
    assert!(quiet.iter().all(|range| range.buoy != 3 && range.in_epoch == 0));
    assert_eq!(quiet.len() * 4, ranges(&source).len() * 3);
}

#[test]
fn late_readings_keep_their_stamps_and_arrive_in_order() {
    let source = vehicle(60);
    let delayed = through(&["ps.delay=2,0.5"], 1, &source);
    for reading in of(Sensor::Ps, &delayed) {
        let late = (Time(reading.header().t_arrival) - reading.t_valid()).as_seconds();
        assert!((2.0..2.5).contains(&late), "{late}");
    }
    assert_eq!(depths(&delayed).len(), depths(&source).len());
    let shuffled: Vec<f64> = depths(&through(&["ps.out_of_order=0.1,0.1"], 1, &source)).iter().map(|d| d.0).collect();
    let overtaken = shuffled.windows(2).filter(|pair| pair[1] < pair[0]).count();
    assert!(overtaken > 30 && overtaken < 90, "{overtaken} of 600 swapped with a neighbour");
    let batch = of(Sensor::Ps, &through(&["ps.batch=5@10..20"], 1, &source));
    let at = |t: f64| batch.iter().filter(|r| r.header().t_arrival == Time::from_seconds(t).0).count();
    assert_eq!((at(15.0), at(20.0)), (50, 50));
}

#[test]
fn stamps_are_off_as_said() {
    let source = vehicle(200);
    let offset = |spec: &str, at: f64| {
        let reading = of(Sensor::Dvl, &through(&[spec], 1, &source));
        let near = reading.iter().min_by_key(|r| (r.header().t_arrival - Time::from_seconds(at).0).abs());
        near.map(|r| (r.t_valid() - Time(r.header().t_arrival)).as_seconds()).expect("readings")
    };
    assert!((offset("dvl.stamp=0.4@50..100", 70.01) - 0.4).abs() < 1e-12);
    assert!((offset("dvl.stamp=0.4@50..100", 100.01) - 0.0).abs() < 1e-12);
    assert!((offset("dvl.stamp_wander=0.2,0.1,40@50..", 60.01) - 0.3).abs() < 1e-4);
    assert!((offset("dvl.stamp_steps=0.1,0.3,20@50..", 65.01) - 0.1).abs() < 1e-12);
    assert!((offset("dvl.stamp_steps=0.1,0.3,20@50..", 75.01) - 0.3).abs() < 1e-12);
    assert!((offset("dvl.stamp_ramp=1e-4@50..", 150.01) - 0.010_001).abs() < 1e-8);
    assert_eq!(offset("dvl.stamp_wrap=100", 150.01), -100.0);
    assert!((offset("dvl.stamp_reset@50..", 150.01) + 50.0).abs() < 1e-9);
    let jittered = ranges(&through(&["lbl.stamp_jitter=0.01"], 1, &source));
    assert!(jittered.chunks(4).all(|epoch| epoch.iter().all(|range| range.header.t_valid == epoch[0].header.t_valid)));
    let errors: Vec<f64> =
        jittered.chunks(4).map(|e| (Time(e[0].header.t_valid) - Time(e[0].header.t_arrival)).as_seconds()).collect();
    let sigma = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    assert!((sigma - 0.01).abs() < 4.0 * 0.01 / (2.0 * errors.len() as f64).sqrt(), "{sigma}");
}

#[test]
fn contents_are_spoilt_as_said() {
    let source = vehicle(400);
    let nan = depths(&through(&["ps.nan=0.1"], 1, &source));
    assert_share(nan.iter().filter(|d| d.1.is_nan()).count(), nan.len(), 0.1, "nan");
    let frozen = depths(&through(&["ps.stuck@10..20"], 1, &source));
    let within: Vec<f64> = frozen.iter().filter(|d| (10.0..20.0).contains(&d.0)).map(|d| d.1).collect();
    assert!(within.iter().all(|depth| *depth == within[0]) && within[0] < 5.1, "the last one before: {}", within[0]);
    let spiky = depths(&through(&["ps.spikes=0.03,5"], 1, &source));
    let sizes: Vec<f64> =
        spiky.iter().zip(depths(&source)).map(|(a, b)| (a.1 - b.1).abs()).filter(|x| *x > 0.0).collect();
    assert_share(sizes.len(), spiky.len(), 0.03, "spikes");
    assert!(sizes.iter().all(|size| (2.5..=7.5).contains(size)));
    // Across north the compass goes on with small numbers.
    let turned = through(&["mcp.bias=20"], 1, &source);
    assert!(
        of(Sensor::Mcp, &turned)
            .iter()
            .all(|r| matches!(r, RawReading::Mcp(m) if (0.0..360.0).contains(&m.heading_deg)))
    );
    let scaled = ranges(&through(&["lbl.scale=1.01"], 1, &source));
    assert!(scaled.iter().zip(ranges(&source)).all(|(a, b)| (a.range / b.range - 1.01).abs() < 1e-12));
    let reversed = of(Sensor::Dvl, &through(&["dvl.mounting=180"], 1, &source));
    assert!(reversed.iter().all(|r| matches!(r, RawReading::Dvl(d) if (d.velocity_dvl[0] + 1.0).abs() < 1e-12)));
    let swapped = ranges(&through(&["lbl.identity=1,2,1"], 1, &source));
    assert_eq!(swapped[..4].iter().map(|range| range.buoy).collect::<Vec<u32>>(), [2, 1, 3, 4]);
}

#[test]
fn fixes_are_off_by_the_metres_said() {
    let source = vehicle(60);
    let off = |spec: &str| -> Vec<f64> {
        let metres_per_degree = 111_195.0 * 36.0_f64.to_radians().cos();
        let east = |r: &RawReading| match r {
            RawReading::Gnss(fix) => (fix.lon_deg - 127.0) * metres_per_degree,
            RawReading::Buoy(fix) => (fix.lon_deg - 127.0) * metres_per_degree,
            _ => f64::NAN,
        };
        let sensor = if spec.starts_with("gnss") { Sensor::Gnss } else { Sensor::Buoys };
        of(sensor, &through(&[spec], 1, &source)).iter().map(east).collect()
    };
    // A sphere instead of the ellipsoid: half a percent.
    assert!(off("gnss.jump=300,90").iter().all(|east| (east - 300.0).abs() < 2.0));
    let dragged = off("gnss.drag=2,90@10..");
    assert!(dragged[9] == 0.0 && (dragged[39] - 2.0 * 29.5).abs() < 0.5, "{}", dragged[39]);
    let poor = off("gnss.poor=20,5");
    assert!(poor[0].abs() >= 9.9 && poor[40].abs() < 0.02 * poor[0].abs(), "{} then {}", poor[0], poor[40]);
    let moved = off("buoys.moved=50,90,2");
    assert!(moved[0] == 0.0 && (moved[1] - 50.0).abs() < 0.5, "{moved:?}");
}

#[test]
fn a_source_s_error_comes_through_and_ends_it() {
    let spec = "ps.delay=100".parse().expect("a fault");
    let ps = of(Sensor::Ps, &vehicle(1));
    let source = ps.iter().copied().map(Ok).chain([Err("torn")]).chain([Err("never")]);
    let mut stream = FaultStream::new(&[spec], 1, ArrivalClock::Valid).over(source);
    assert_eq!(stream.next(), Some(Err("torn")));
    assert_eq!(stream.next(), None);
}

#[test]
fn a_recording_is_ordered_by_its_arrival() {
    let reading = |t: i64, t_arrival: i64| {
        RawReading::Ps(PsDepth { header: Header { t_arrival, ..Header::at(Time(t)) }, depth: 1.0 })
    };
    let mut stream = FaultStream::new(&["ps.delay=1e-9@..5e-9".parse().expect("a fault")], 1, ArrivalClock::Arrival);
    for (t, t_arrival) in [(2, 100), (9, 101), (8, 103)] {
        stream.push(reading(t, t_arrival));
    }
    stream.finish();
    let order: Vec<(i64, i64)> =
        std::iter::from_fn(|| stream.pop()).map(|r| (r.t_valid().0, r.header().t_arrival)).collect();
    assert_eq!(order, [(2, 101), (9, 101), (8, 103)]);
}
