//! A recording in an MCAP: what goes in comes out, and what is torn, damaged or foreign is named.
#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing test")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use ilns_recording::mcap::{McapWriter, RecorderStatus, export, inspect, recover};
use ilns_recording::{LogWriter, LogWriterOptions};
use proptest::prelude::*;
use shared_types::{
    BuoyFix, DvlVelocity, GnssFix, Header, Heartbeat, HopLatency, ImuSample, KeyframeReport, LblRange, McpHeading,
    Mode, NavEstimate, PsDepth, RawReading, SensorHealth, Time, Truth,
};

const CONFIG: &str = "# two words\n[lbl]\nsigma = 1.0\n";

fn header(index: u64) -> Header {
    let t_arrival = 77_000_000_000_000_001 + index as i64 * 5_000_000;
    Header { sequence: index, t_arrival, ..Header::at(Time(1_700_000_000_000_000_003 + index as i64 * 5_000_000)) }
}

/// Every sensor, with thirds, no numbers, infinities and negative zeros among them.
fn readings(count: u64) -> Vec<RawReading> {
    let mut all = Vec::new();
    for index in 0..count {
        let header = header(index);
        let third = (index as f64 + 1.0) / 3.0;
        all.push(RawReading::Imu(ImuSample {
            header,
            gyro_body: [third, -0.0, 1e-300],
            accel_body: [0.1, f64::NAN, 9.8],
        }));
        if index % 20 == 0 {
            all.push(RawReading::Lbl(LblRange { header, buoy: 4, in_epoch: 1, range: third * 1e3 }));
            all.push(RawReading::Dvl(DvlVelocity { header, velocity_dvl: [third, f64::INFINITY, f64::NEG_INFINITY] }));
            all.push(RawReading::Mcp(McpHeading { header, heading_deg: 359.0 + third / 1e3 }));
            all.push(RawReading::Ps(PsDepth { header, depth: third }));
        }
        if index % 100 == 0 {
            let (lat_deg, lon_deg) = (36.0 + third * 1e-6, 127.0);
            all.push(RawReading::Gnss(GnssFix {
                header,
                lat_deg,
                lon_deg,
                height: f64::NAN,
                sigma_enu: [f64::NAN; 3],
            }));
            all.push(RawReading::Buoy(BuoyFix { header, buoy: 4, moored: 1, lat_deg, lon_deg, height: 0.1 + third }));
        }
    }
    all
}

fn truth(index: u64) -> Truth {
    Truth {
        header: Header::at(Time(header(index).t_valid)),
        lat_deg: 36.0 + index as f64 / 7e6,
        lon_deg: 127.0,
        height: -1.0 / 3.0,
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        velocity_enu: [0.5, -0.0, 0.0],
    }
}

fn estimate(index: u64) -> NavEstimate {
    let cov = [4.0, 1.0, 0.0, 9.0, 0.0, 1.0];
    NavEstimate {
        header: header(index),
        solution: 5,
        t_keyframe: 0,
        position_enu: [1.0 / 3.0, 2.0, 3.0],
        velocity_enu: [0.5, 0.0, 0.0],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: cov,
        velocity_cov: cov,
        attitude_cov: cov,
        sigma_rpy: [0.1; 3],
        lat_lon_h: [36.0, 127.0, 0.0],
        aiding_age: [f64::INFINITY; 5],
        mode: Mode::Ok as u32,
        reserved: 0,
    }
}

fn heartbeat() -> Heartbeat {
    Heartbeat {
        header: Header::default(),
        process: 10,
        state: 1,
        pid: 1,
        restarts: 0,
        cpu_ns: 1,
        resident_bytes: 1,
        dropped: 0,
        handled: 1,
        sensors: [SensorHealth::NONE; 7],
        hop_in: HopLatency { count: 1, p50_ns: 1, p99_ns: 2, max_ns: 3, ..HopLatency::default() },
        end_to_end: HopLatency::default(),
        work: HopLatency::default(),
    }
}

/// The same run as a log directory and as an MCAP that is flushed every hundred samples.
fn record(folder: &Path, samples: u64, finish: bool) -> (PathBuf, PathBuf) {
    let (log, file) = (folder.join("log"), folder.join("recording.mcap"));
    let options = LogWriterOptions { arrival_columns: true, replace: false };
    let mut directory = LogWriter::create(&log, options).unwrap();
    directory.sensors_toml(CONFIG).unwrap();
    let mut mcap = McapWriter::create(&file, CONFIG).unwrap();
    mcap.origin([36.0, 127.0, 0.0]).unwrap();
    for (index, reading) in readings(samples).iter().enumerate() {
        directory.reading(reading).unwrap();
        mcap.reading(reading).unwrap();
        if let RawReading::Imu(sample) = reading {
            mcap.estimate(&estimate(sample.header.sequence)).unwrap();
            if sample.header.sequence % 20 == 0 {
                directory.truth(&truth(sample.header.sequence)).unwrap();
                mcap.truth(&truth(sample.header.sequence)).unwrap();
                mcap.report(&KeyframeReport::empty()).unwrap();
                mcap.heartbeat(&heartbeat()).unwrap();
            }
        }
        if index % 100 == 99 {
            mcap.flush(RecorderStatus { dropped: 2, lost: 1 }).unwrap();
        }
    }
    directory.finish().unwrap();
    if finish {
        mcap.finish().unwrap();
    } else {
        // As after `kill -9`: nothing more reaches the file.
        let torn = fs::read(&file).unwrap();
        mcap.finish().unwrap();
        fs::write(&file, torn).unwrap();
    }
    (log, file)
}

fn assert_same_files(a: &Path, b: &Path) {
    let names = |dir: &Path| {
        let mut names: Vec<_> = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names(a), names(b));
    for name in names(a) {
        assert!(fs::read(a.join(&name)).unwrap() == fs::read(b.join(&name)).unwrap(), "{name:?} differs");
    }
}

#[test]
fn an_exported_log_has_the_bytes_of_the_recorded_one() {
    let folder = tempfile::tempdir().unwrap();
    let (log, file) = record(folder.path(), 1000, true);
    let out = folder.path().join("exported");
    let exported = export(&[&file], &out).unwrap();
    assert!(exported.endings[0].is_whole(), "{:?}", exported.endings);
    assert_eq!((exported.rows["imu.csv"], exported.rows["lbl.csv"], exported.rows["truth.csv"]), (1000, 50, 50));
    assert_same_files(&log, &out);
}

#[test]
fn a_recording_in_two_files_is_exported_as_one_log() {
    let folder = tempfile::tempdir().unwrap();
    let (log, _) = record(folder.path(), 400, true);
    let [first, second] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    let mut mcap = McapWriter::create(&first, CONFIG).unwrap();
    let all = readings(400);
    for (index, reading) in all.iter().enumerate() {
        if index == all.len() / 2 {
            mcap.go_on_in(&second, CONFIG).unwrap();
        }
        mcap.reading(reading).unwrap();
    }
    mcap.finish().unwrap();
    let out = folder.path().join("exported");
    let exported = export(&[&first, &second], &out).unwrap();
    assert!(exported.endings.iter().all(|ending| ending.is_whole()));
    fs::remove_file(log.join("truth.csv")).unwrap();
    assert_same_files(&log, &out);
}

#[test]
fn an_inspection_counts_messages_gaps_and_losses() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recording.mcap");
    let mut mcap = McapWriter::create(&file, CONFIG).unwrap();
    for index in (0..100).filter(|index| !(40..47).contains(index)) {
        let sample = ImuSample { header: header(index), gyro_body: [0.0; 3], accel_body: [0.0; 3] };
        mcap.reading(&RawReading::Imu(sample)).unwrap();
    }
    mcap.flush(RecorderStatus { dropped: 7, lost: 3 }).unwrap();
    mcap.finish().unwrap();
    let found = inspect(&file).unwrap();
    let imu = found.channels.iter().find(|channel| channel.topic == "/sensor/imu").unwrap();
    assert_eq!((imu.messages, imu.missing, imu.schema.as_str()), (93, 7, "ilns.ImuSample"));
    assert_eq!(imu.longest_gap.map(|(gap, at)| (gap.0, at)), Some((40_000_000, Time(header(39).t_valid))));
    assert_eq!((found.dropped, found.lost), (7, 3));
    assert_eq!(found.attachments, ["sensors.toml"]);
    assert!(found.ending.is_whole());
}

#[test]
fn a_torn_recording_is_made_whole_up_to_its_last_flush() {
    let folder = tempfile::tempdir().unwrap();
    let (log, file) = record(folder.path(), 1000, false);
    assert!(!inspect(&file).unwrap().ending.is_whole());
    let whole = folder.path().join("whole.mcap");
    let recovered = recover(&file, &whole).unwrap();
    assert!(recovered.messages > 1000, "{recovered:?}");
    assert!(inspect(&whole).unwrap().ending.is_whole());
    let (torn_out, out) = (folder.path().join("torn"), folder.path().join("out"));
    export(&[&file], &torn_out).unwrap();
    export(&[&whole], &out).unwrap();
    assert_same_files(&torn_out, &out);
    let imu = |dir: &Path| fs::read_to_string(dir.join("imu.csv")).unwrap();
    assert!(imu(&log).starts_with(&imu(&out)), "what is there is as it was");
    let lost = imu(&log).lines().count() - imu(&out).lines().count();
    assert!(lost < 100, "{lost} samples lost between two flushes of a hundred readings");
}

#[test]
fn a_file_cut_off_anywhere_is_named_or_read_and_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let (_, file) = record(folder.path(), 100, true);
    let bytes = fs::read(&file).unwrap();
    let (cut, out) = (folder.path().join("cut.mcap"), folder.path().join("out.mcap"));
    let mut most = 0;
    for length in (0..200).chain((200..bytes.len()).step_by(211)).chain(bytes.len() - 100..bytes.len()) {
        fs::write(&cut, &bytes[..length]).unwrap();
        let found = inspect(&cut);
        let recovered = recover(&cut, &out);
        assert_eq!(found.is_ok(), length >= 8, "{length}: {found:?}");
        assert_eq!(recovered.is_ok(), length >= 8, "{length}: {recovered:?}");
        if let (Ok(found), Ok(recovered)) = (found, recovered) {
            assert!(!found.ending.is_whole(), "{length}");
            assert_eq!(found.messages(), recovered.messages);
            assert!(recovered.messages >= most, "a longer file does not hold less: {length}");
            most = recovered.messages;
            assert!(inspect(&out).unwrap().ending.is_whole());
            fs::remove_file(&out).unwrap();
        }
    }
    assert_eq!(most, inspect(&file).unwrap().messages());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]
    #[test]
    fn a_file_with_flipped_bits_is_never_a_panic(flips in prop::collection::vec((any::<prop::sample::Index>(), 0..8_u32), 1..6)) {
        let folder = tempfile::tempdir().unwrap();
        let (_, file) = record(folder.path(), 60, true);
        let mut bytes = fs::read(&file).unwrap();
        for (place, bit) in flips {
            let place = place.index(bytes.len());
            bytes[place] ^= 1 << bit;
        }
        fs::write(&file, bytes).unwrap();
        let _ = inspect(&file);
        let _ = export(&[&file], folder.path().join("out"));
        if recover(&file, folder.path().join("whole.mcap")).is_ok() {
            prop_assert!(inspect(folder.path().join("whole.mcap")).unwrap().ending.is_whole());
        }
    }

    #[test]
    fn any_bytes_behind_the_magic_are_never_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), op in 1..16_u8) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("any.mcap");
        let mut all = b"\x89MCAP0\r\n".to_vec();
        all.push(op);
        all.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        all.extend_from_slice(&bytes);
        fs::write(&file, all).unwrap();
        prop_assert!(!inspect(&file).unwrap().ending.is_whole());
    }
}

#[test]
fn foreign_and_future_files_are_named_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("x.mcap");
    let cases: [(&[u8], &str); 4] = [
        (b"", "ends within its first 0 bytes"),
        (b"\x89MCAP", "ends within its first 5 bytes"),
        (b"t,wx,wy,wz\n1,2,3,4\n", "not an MCAP file"),
        (b"\x89MCAP1\r\n", "major version '1'"),
    ];
    for (bytes, expected) in cases {
        fs::write(&file, bytes).unwrap();
        for message in [
            inspect(&file).unwrap_err().to_string(),
            recover(&file, folder.path().join("y.mcap")).unwrap_err().to_string(),
            export(&[&file], folder.path().join("out")).unwrap_err().to_string(),
        ] {
            assert!(message.contains(expected) && message.contains("x.mcap") && !message.contains('\n'), "{message}");
        }
    }
    assert!(!folder.path().join("y.mcap").exists(), "nothing is left behind");
    fs::write(&file, b"\x89MCAP0\r\n").unwrap();
    let message = export(&[&file], folder.path().join("out")).unwrap_err().to_string();
    assert!(message.contains("no `/sensor/imu`"), "{message}");
}

#[test]
fn nothing_is_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let (log, file) = record(folder.path(), 10, true);
    assert!(McapWriter::create(&file, CONFIG).is_err());
    assert!(recover(&file, &file).is_err());
    let message = export(&[&file], &log).unwrap_err().to_string();
    assert!(message.contains("already holds a log"), "{message}");
}

/// What another implementation makes of the file: counts per topic, every message parsed, floats by their bits.
const READER: &str = r#"
import json, sys
from mcap.reader import SeekingReader
counts, first = {}, {}
with open(sys.argv[1], "rb") as stream:
    reader = SeekingReader(stream, validate_crcs=True)
    summary = reader.get_summary()
    for schema, channel, message in reader.iter_messages():
        assert channel.message_encoding == "json" and schema.encoding == "jsonschema"
        value = json.loads(message.data)
        properties = json.loads(schema.data)["properties"]
        unknown = set(value) - set(properties)
        assert not unknown, (channel.topic, unknown)
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
        first.setdefault(channel.topic, value)
    attachments = [a.name for a in reader.iter_attachments()]
assert summary.statistics.message_count == sum(counts.values())
print(json.dumps({"counts": counts, "wx": first["/sensor/imu"]["wx"].hex(), "attachments": attachments,
                  "pose": first["/pose"]["frame_id"], "chunks": summary.statistics.chunk_count,
                  "corners": len(first["/scene"]["entities"][0]["lines"][0]["points"])}))
"#;

#[test]
fn an_independent_reader_reads_whole_and_recovered_files() {
    let has_reader = Command::new("python3").args(["-c", "import mcap.reader"]).output();
    if !has_reader.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: python3 has no package `mcap` (`pip install mcap` in a virtual environment)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (_, torn) = record(folder.path(), 1000, false);
    let recovered = folder.path().join("recovered.mcap");
    recover(&torn, &recovered).unwrap();
    let other = folder.path().join("other");
    let (_, whole) = record(&other, 1000, true);
    for file in [whole, recovered] {
        let output = Command::new("python3").args(["-c", READER]).arg(&file).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let read: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        for channel in inspect(&file).unwrap().channels.iter().filter(|channel| channel.messages > 0) {
            assert_eq!(read["counts"][&channel.topic].as_u64(), Some(channel.messages), "{}", channel.topic);
        }
        // 1/3 as Python writes it: the same bits.
        assert_eq!(read["wx"], "0x1.5555555555555p-2");
        assert_eq!(read["attachments"][0], "sensors.toml");
        assert_eq!((&read["pose"], &read["corners"]), (&"map".into(), &48.into()));
    }
}

#[test]
fn the_layout_for_foxglove_shows_channels_and_panels_that_exist() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/foxglove/layout.json");
    let text = fs::read_to_string(file).unwrap();
    let layout: serde_json::Value = serde_json::from_str(&text).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (_, recording) = record(folder.path(), 10, true);
    let channels: Vec<String> = inspect(recording).unwrap().channels.into_iter().map(|channel| channel.topic).collect();
    let mut named = 0;
    for quoted in text.split('"').filter(|quoted| quoted.starts_with('/')) {
        let topic = quoted.split('.').next().unwrap();
        assert!(channels.iter().any(|channel| channel == topic), "{topic}");
        named += 1;
    }
    assert!(named >= 10, "{named}");
    let mosaic = layout["layout"].to_string();
    for panel in layout["configById"].as_object().unwrap().keys() {
        assert!(mosaic.contains(panel), "{panel}");
    }
}

#[test]
fn a_recording_of_a_later_format_is_not_exported_by_guessing() {
    let folder = tempfile::tempdir().unwrap();
    let (_, file) = record(folder.path(), 10, true);
    let mut bytes = fs::read(&file).unwrap();
    let said = b"format\x01\0\0\x001";
    let place = bytes.windows(said.len()).position(|window| window == said).unwrap();
    bytes[place + said.len() - 1] = b'9';
    fs::write(&file, bytes).unwrap();
    let message = export(&[&file], folder.path().join("out")).unwrap_err().to_string();
    assert!(message.contains("later version of this program recorded it (format 9"), "{message}");
    assert!(!folder.path().join("out").exists());
}
