//! A recording that is read back gives the same bits.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use ilns_recording::{LogDirectory, LogWriter, LogWriterOptions};
use proptest::prelude::*;
use shared_types::{
    BuoyFix, DvlVelocity, GnssFix, Header, ImuSample, LblRange, McpHeading, PsDepth, RawReading, Time, Truth,
};

/// Any bit pattern but for the payload of a NaN, which text does not carry.
fn number() -> impl Strategy<Value = f64> {
    any::<u64>().prop_map(f64::from_bits).prop_map(|value| if value.is_nan() { f64::NAN } else { value })
}

fn vector() -> impl Strategy<Value = [f64; 3]> {
    [number(), number(), number()]
}

fn reading() -> impl Strategy<Value = RawReading> {
    let header = Header::default();
    prop_oneof![
        (vector(), vector()).prop_map(move |(gyro_body, accel_body)| RawReading::Imu(ImuSample {
            header,
            gyro_body,
            accel_body
        })),
        (any::<u32>(), any::<u32>(), number()).prop_map(move |(buoy, in_epoch, range)| RawReading::Lbl(LblRange {
            header,
            buoy,
            in_epoch,
            range
        })),
        (any::<u32>(), 0..2_u32, vector()).prop_map(move |(buoy, moored, [lat_deg, lon_deg, height])| {
            RawReading::Buoy(BuoyFix { header, buoy, moored, lat_deg, lon_deg, height })
        }),
        (vector(), vector()).prop_map(move |([lat_deg, lon_deg, height], sigma_enu)| {
            RawReading::Gnss(GnssFix { header, lat_deg, lon_deg, height, sigma_enu })
        }),
        vector().prop_map(move |velocity_dvl| RawReading::Dvl(DvlVelocity { header, velocity_dvl })),
        number().prop_map(move |heading_deg| RawReading::Mcp(McpHeading { header, heading_deg })),
        number().prop_map(move |depth| RawReading::Ps(PsDepth { header, depth })),
    ]
}

fn stamp(reading: &mut RawReading, stamp: Header) {
    *match reading {
        RawReading::Imu(r) => &mut r.header,
        RawReading::Buoy(r) => &mut r.header,
        RawReading::Gnss(r) => &mut r.header,
        RawReading::Dvl(r) => &mut r.header,
        RawReading::Mcp(r) => &mut r.header,
        RawReading::Ps(r) => &mut r.header,
        RawReading::Lbl(r) => &mut r.header,
    } = stamp;
}

/// Everything as text that tells -0 from 0 and NaN from NaN not at all: equal text, equal bits.
fn bits(readings: &[RawReading]) -> Vec<String> {
    readings.iter().map(|reading| format!("{reading:?}")).collect()
}

proptest! {
    #[test]
    fn a_recording_read_back_gives_the_same_bits(
        mut readings in prop::collection::vec((reading(), any::<i32>(), any::<u64>()), 1..60)
    ) {
        let dir = tempfile::tempdir().unwrap();
        let options = LogWriterOptions { arrival_columns: true, replace: false };
        let mut writer = LogWriter::create(dir.path(), options).unwrap();
        let mut expected = Vec::new();
        // The log needs an IMU sample to be one.
        let first = ImuSample { header: Header::default(), gyro_body: [0.0; 3], accel_body: [0.0; 3] };
        writer.imu(&first).unwrap();
        expected.push(RawReading::Imu(first));
        for (index, (reading, t, sequence)) in readings.iter_mut().enumerate() {
            // Valid at any time in any order; arrivals are in order.
            let t_arrival = 1_000_000_000_000_000_001 + index as i64;
            let t_valid = i64::from(*t) * 1_000_003;
            stamp(reading, Header { sequence: *sequence, t_arrival, ..Header::at(Time(t_valid)) });
            writer.reading(reading).unwrap();
            expected.push(*reading);
        }
        writer.finish().unwrap();
        let read: Vec<RawReading> =
            LogDirectory::open(dir.path()).unwrap().merged().unwrap().collect::<Result<_, _>>().unwrap();
        prop_assert_eq!(bits(&read), bits(&expected));
    }

    #[test]
    fn a_truth_read_back_gives_the_same_bits(rows in prop::collection::vec((vector(), vector(), vector(), number()), 1..20)) {
        let dir = tempfile::tempdir().unwrap();
        let mut writer = LogWriter::create(dir.path(), LogWriterOptions::default()).unwrap();
        let imu = ImuSample { header: Header::default(), gyro_body: [0.0; 3], accel_body: [0.0; 3] };
        writer.imu(&imu).unwrap();
        let mut expected = Vec::new();
        for (index, ([lat_deg, lon_deg, height], velocity_enu, [qx, qy, qz], qw)) in rows.into_iter().enumerate() {
            let header = Header { sequence: index as u64, ..Header::at(Time(index as i64 * 100_000_000)) };
            let truth = Truth { header, lat_deg, lon_deg, height, q_enu_body: [qw, qx, qy, qz], velocity_enu };
            writer.truth(&truth).unwrap();
            expected.push(format!("{truth:?}"));
        }
        writer.finish().unwrap();
        let log = LogDirectory::open(dir.path()).unwrap();
        let read: Vec<String> = log.truth().unwrap().map(|truth| format!("{:?}", truth.unwrap())).collect();
        prop_assert_eq!(read, expected);
    }
}
