//! What the files of a 2217 s mission at 200 Hz cost: IMU file in, one estimate per sample out.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use ilns_recording::{EstimateWriter, LogDirectory, LogWriter, LogWriterOptions, read_estimates};
use shared_types::{Header, ImuSample, NavEstimate, Time};

const SAMPLES: i64 = 443_400;
const PERIOD_NS: i64 = 5_000_000;

/// A number with all its digits, as a simulation writes it.
fn wave(index: i64, axis: usize) -> f64 {
    (index as f64 * 1e-3 * (1.0 + axis as f64)).sin()
}

fn write_log(dir: &Path) {
    let mut writer =
        LogWriter::create(dir, LogWriterOptions { replace: true, ..LogWriterOptions::default() }).expect("a folder");
    for index in 0..SAMPLES {
        let sample = ImuSample {
            header: Header::at(Time(index * PERIOD_NS)),
            gyro_body: std::array::from_fn(|axis| wave(index, axis)),
            accel_body: std::array::from_fn(|axis| 9.8 * wave(index, axis + 3)),
        };
        writer.imu(&sample).expect("a row");
    }
    writer.finish().expect("a file");
}

fn estimate(index: i64) -> NavEstimate {
    let vector = |scale: f64| std::array::from_fn(|axis| scale * wave(index, axis));
    NavEstimate {
        header: Header::at(Time(index * PERIOD_NS)),
        solution: (index / 200) as u64,
        t_keyframe: index / 200 * 1_000_000_000,
        position_enu: vector(1000.0),
        velocity_enu: vector(2.0),
        q_enu_body: std::array::from_fn(|axis| 0.5 * wave(index, axis)),
        accel_bias: vector(1e-2),
        gyro_bias: vector(1e-5),
        position_cov: [wave(index, 0).abs(); 6],
        velocity_cov: [1e-4 * wave(index, 1).abs(); 6],
        attitude_cov: [1e-6; 6],
        sigma_rpy: [1e-3 * wave(index, 2).abs(); 3],
        lat_lon_h: [36.38 + 1e-3 * wave(index, 0), 127.36 + 1e-3 * wave(index, 1), -10.0],
        aiding_age: [0.0; 5],
        mode: 1,
        reserved: 0,
    }
}

fn write_estimates(out: &Path, estimates: &[NavEstimate]) {
    let mut writer = EstimateWriter::create(out).expect("a folder");
    for estimate in estimates {
        writer.write(estimate).expect("a row");
    }
    writer.finish().expect("two files");
}

fn speed(criterion: &mut Criterion) {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let estimates: Vec<NavEstimate> = (0..SAMPLES).map(estimate).collect();
    let mut group = criterion.benchmark_group("mission");
    group.sample_size(10);
    group.bench_function("write imu.csv", |bench| bench.iter(|| write_log(dir.path())));
    let log = LogDirectory::open(dir.path()).expect("the log just written");
    group.bench_function("read imu.csv", |bench| {
        bench.iter(|| {
            for sample in log.imu().expect("its file") {
                black_box(sample.expect("a row"));
            }
        });
    });
    group.bench_function("read merged", |bench| {
        bench.iter(|| {
            for reading in log.merged().expect("its files") {
                black_box(reading.expect("a row"));
            }
        });
    });
    group.bench_function("write estimates", |bench| bench.iter(|| write_estimates(dir.path(), &estimates)));
    group.bench_function("read estimates", |bench| {
        bench.iter(|| {
            for row in read_estimates(dir.path().join("estimate.csv")).expect("the file just written") {
                black_box(row.expect("a row"));
            }
        });
    });
    group.finish();
}

criterion_group!(benches, speed);
criterion_main!(benches);
