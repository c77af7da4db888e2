//! The last solution, kept on disk for the solver that comes after one that died, or after a restart of the machine.
//!
//! ```text
//! "ILNSSOLN" | version u32 | CRC-32 of the payload u32 | payload: bincode, fixed-width integers, little endian
//! ```
//!
//! The payload begins with a hash of the configuration that the solution was found with (a state in another vehicle's lever
//! arms and frame is no state of this one) and with what the machine's clocks said: whoever reads it judges by them how old it
//! is, and whether a start of the machine lies between ([`CheckpointTerms`]).
//!
//! A latched message dies with its sender, so shared memory cannot keep it. Written whole or not at all (a second file, then
//! a rename); read back only if magic, version, length and checksum agree.

mod terms;

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};
use shared_types::{Clocks, Header, Message, REJECT_REASONS, SensorCounts, Solution};

use crate::error::LogError;

pub use terms::{CheckpointTerms, Kept, kept_file};

const MAGIC: &[u8; 8] = b"ILNSSOLN";
const HEAD: usize = MAGIC.len() + 8;
/// Far above what a solution takes: a length from a damaged file must not allocate.
const LIMIT: usize = 1 << 16;

/// A file that holds no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// Shorter than its head, or another kind of file.
    #[error("it is no checkpoint")]
    Foreign,
    /// Written by a program with another layout of the solution.
    #[error("it is of another version")]
    Version,
    /// Torn or damaged.
    #[error("its checksum does not agree")]
    Damaged,
    /// Of another vehicle, or of this one with other settings.
    #[error("it was written under another configuration")]
    Configuration,
    /// What happened since cannot be made up for.
    #[error("it is stale: {age_s} s old, where {most_s} s can be made up for")]
    Stale {
        /// Its age, s.
        age_s: i64,
        /// Largest that is taken, s.
        most_s: i64,
    },
    /// The machine has been started since: its monotonic clock began anew.
    #[error("it is of before the machine was started anew")]
    OtherBoot,
    /// Nothing tells its age.
    #[error(
        "by the machine's clock it was written {ahead_s} s from now: the clock was set back, and nothing tells its age"
    )]
    ClockRanBackwards {
        /// How far ahead, s.
        ahead_s: i64,
    },
}

/// A solution and the circumstances under which it was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checkpoint {
    /// [`configuration_hash`] of the configuration that it was found with.
    pub configuration: u64,
    /// The machine's clocks when it was published.
    pub written: Clocks,
    /// Without its sender and how it was found.
    pub solution: Solution,
}

/// What a checkpoint is to survive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// The end of the process that writes it.
    Process,
    /// The loss of power too: it is on the disk when the writing is over, which may take as long as the disk likes.
    Power,
}

/// Tells configurations apart, given the whole effective one as TOML.
pub fn configuration_hash(toml: &str) -> u64 {
    (u64::from(crc32fast::hash(toml.as_bytes())) << 32) | toml.len() as u64
}

/// What is kept of a [`Solution`]; the sender is not.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Layout {
    configuration: u64,
    boot: u128,
    mono: i64,
    wall: i64,
    id: u64,
    t_keyframe: i64,
    origin: [f64; 3],
    position_enu: [f64; 3],
    velocity_enu: [f64; 3],
    q_enu_body: [f64; 4],
    accel_bias: [f64; 3],
    gyro_bias: [f64; 3],
    covariance: [[f64; 15]; 15],
    t_last_used: [i64; 5],
    time_offset: [f64; 5],
    time_offset_sigma: [f64; 5],
    calibration: [f64; 2],
    calibration_sigma: [f64; 2],
    counts: [(u64, [u64; REJECT_REASONS.len()]); 7],
}

fn encoding() -> impl bincode::config::Config {
    bincode::config::standard().with_fixed_int_encoding().with_limit::<LIMIT>()
}

/// Of what stands beside the solution.
const CIRCUMSTANCES: u32 = 2;

/// The layout that this program writes: that of the message itself, and of what stands beside it.
fn version() -> u32 {
    (Solution::LAYOUT ^ (Solution::LAYOUT >> 32)) as u32 ^ CIRCUMSTANCES
}

/// Writes it whole or not at all.
///
/// # Errors
/// [`LogError::Io`].
pub fn write_checkpoint(file: &Path, checkpoint: &Checkpoint, durability: Durability) -> Result<(), LogError> {
    let partial = file.with_extension("partial");
    let bytes = encode(checkpoint);
    match durability {
        Durability::Process => fs::write(&partial, bytes).map_err(LogError::io(&partial, "write"))?,
        // A rename may reach the disk before what it names: a loss of power between the two would leave an empty file.
        Durability::Power => {
            let written =
                File::create(&partial).and_then(|mut open| open.write_all(&bytes).and_then(|()| open.sync_data()));
            written.map_err(LogError::io(&partial, "write"))?;
        }
    }
    fs::rename(&partial, file).map_err(LogError::io(file, "write"))?;
    match file.parent() {
        Some(folder) if durability == Durability::Power => {
            File::open(folder).and_then(|open| open.sync_all()).map_err(LogError::io(folder, "write"))
        }
        _ => Ok(()),
    }
}

fn encode(checkpoint: &Checkpoint) -> Vec<u8> {
    let Checkpoint { configuration, written, solution } = checkpoint;
    let kept = Layout {
        configuration: *configuration,
        boot: written.boot,
        mono: written.mono,
        wall: written.wall,
        id: solution.id,
        t_keyframe: solution.t_keyframe,
        origin: solution.origin,
        position_enu: solution.position_enu,
        velocity_enu: solution.velocity_enu,
        q_enu_body: solution.q_enu_body,
        accel_bias: solution.accel_bias,
        gyro_bias: solution.gyro_bias,
        covariance: solution.covariance,
        t_last_used: solution.t_last_used,
        time_offset: solution.time_offset,
        time_offset_sigma: solution.time_offset_sigma,
        calibration: solution.calibration,
        calibration_sigma: solution.calibration_sigma,
        counts: solution.counts.map(|counts| (counts.used, counts.rejected)),
    };
    let payload = bincode::serde::encode_to_vec(&kept, encoding()).expect("plain numbers are within the limit");
    let mut bytes = Vec::with_capacity(HEAD + payload.len());
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&version().to_le_bytes());
    bytes.extend_from_slice(&crc32fast::hash(&payload).to_le_bytes());
    bytes.extend_from_slice(&payload);
    bytes
}

/// Reads a checkpoint back, whatever its circumstances; `Ok(None)` where there is no file.
///
/// # Errors
/// [`LogError::Checkpoint`] when the file holds no whole solution of this version, [`LogError::Io`].
pub fn read_checkpoint(file: &Path) -> Result<Option<Checkpoint>, LogError> {
    let bytes = match fs::read(file) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(LogError::io(file, "read")(error)),
    };
    match decode(&bytes) {
        Ok(checkpoint) => Ok(Some(checkpoint)),
        Err(reason) => Err(LogError::Checkpoint { file: file.to_owned(), reason }),
    }
}

fn decode(bytes: &[u8]) -> Result<Checkpoint, CheckpointError> {
    let (head, payload) = bytes.split_at_checked(HEAD).ok_or(CheckpointError::Foreign)?;
    let (magic, numbers) = head.split_at(MAGIC.len());
    if magic != MAGIC {
        return Err(CheckpointError::Foreign);
    }
    let (written_by, checksum) = numbers.split_at(4);
    if written_by != version().to_le_bytes() {
        return Err(CheckpointError::Version);
    }
    if checksum != crc32fast::hash(payload).to_le_bytes() {
        return Err(CheckpointError::Damaged);
    }
    let (kept, used): (Layout, usize) =
        bincode::serde::decode_from_slice(payload, encoding()).map_err(|_| CheckpointError::Damaged)?;
    // bincode accepts trailing bytes in silence.
    if used != payload.len() {
        return Err(CheckpointError::Damaged);
    }
    let written = Clocks { boot: kept.boot, mono: kept.mono, wall: kept.wall };
    let solution = Solution {
        header: Header { t_valid: kept.t_keyframe, t_published: kept.mono, ..Header::default() },
        id: kept.id,
        t_keyframe: kept.t_keyframe,
        origin: kept.origin,
        position_enu: kept.position_enu,
        velocity_enu: kept.velocity_enu,
        q_enu_body: kept.q_enu_body,
        accel_bias: kept.accel_bias,
        gyro_bias: kept.gyro_bias,
        covariance: kept.covariance,
        t_last_used: kept.t_last_used,
        time_offset: kept.time_offset,
        time_offset_sigma: kept.time_offset_sigma,
        calibration: kept.calibration,
        calibration_sigma: kept.calibration_sigma,
        counts: kept.counts.map(|(used, rejected)| SensorCounts { used, rejected }),
        // How it was found is not kept.
        ..Solution::empty()
    };
    Ok(Checkpoint { configuration: kept.configuration, written, solution })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole() -> Vec<u8> {
        encode(&checkpoint())
    }

    pub(super) fn checkpoint() -> Checkpoint {
        let written = Clocks { boot: 0xfb11_e2d9 << 80, mono: 1_000_000_000_000, wall: 1_700_000_000_000_000_000 };
        Checkpoint { configuration: 0x1234_5678_9abc, written, solution: solution() }
    }

    fn solution() -> Solution {
        let mut solution = Solution {
            header: Header { t_valid: 17_000_000_000, t_published: 1_000_000_000_000, ..Header::default() },
            id: 41,
            t_keyframe: 17_000_000_000,
            origin: [36.38, 127.36, 0.0],
            position_enu: [1.0, -2.0, -50.0],
            velocity_enu: [0.5, 0.25, 0.0],
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            accel_bias: [1e-3, 0.0, 0.0],
            gyro_bias: [0.0, 1e-4, 0.0],
            covariance: [[0.5; 15]; 15],
            t_last_used: [1, 2, 3, 4, i64::MIN],
            time_offset: [0.0, 0.25, 0.0, -0.1, 0.0],
            time_offset_sigma: [0.0, 0.01, 0.0, 0.02, 0.0],
            calibration: [1e-3, 0.02],
            calibration_sigma: [1e-4, 0.01],
            counts: [SensorCounts { used: 9, rejected: [3; REJECT_REASONS.len()] }; 7],
            ..Solution::empty()
        };
        solution.covariance[3][4] = -0.125;
        solution
    }

    #[test]
    fn a_solution_is_read_back_to_the_bit() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("solution");
        assert_eq!(read_checkpoint(&file).expect("no file is no error"), None);
        write_checkpoint(&file, &checkpoint(), Durability::Process).expect("it can be written");
        write_checkpoint(&file, &checkpoint(), Durability::Power).expect("it can be replaced");
        assert_eq!(read_checkpoint(&file).expect("it can be read"), Some(checkpoint()));
    }

    #[test]
    fn no_flipped_bit_and_no_torn_end_is_ever_taken_for_a_solution() {
        let whole = whole();
        for at in 0..whole.len() {
            for bit in 0..8 {
                let mut damaged = whole.clone();
                damaged[at] ^= 1 << bit;
                assert!(decode(&damaged).is_err(), "byte {at}, bit {bit}");
            }
            assert!(decode(&whole[..at]).is_err(), "torn at {at}");
        }
        let longer = [whole.as_slice(), &[0]].concat();
        assert_eq!(decode(&longer), Err(CheckpointError::Damaged));
    }

    /// Splitmix64: every run damages in the same way.
    fn draw(state: &mut u64) -> u64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// One of the ways in which a file goes wrong.
    fn damage(whole: &[u8], state: &mut u64) -> Vec<u8> {
        let mut bytes = whole.to_vec();
        let mut below = |limit: usize| (draw(state) % limit as u64) as usize;
        match below(6) {
            // A few bits, anywhere.
            0 => (0..=below(8)).for_each(|_| bytes[below(whole.len())] ^= 1 << below(8)),
            // Torn.
            1 => bytes.truncate(below(whole.len())),
            // A sector that was never written.
            2 => {
                let from = below(whole.len());
                let until = (from + 1 + below(512)).min(whole.len());
                bytes[from..until].fill(0);
            }
            // Noise in its place.
            3 => {
                let from = below(whole.len());
                (from..(from + 1 + below(64)).min(whole.len())).for_each(|at| bytes[at] = below(256) as u8);
            }
            // A piece that has moved.
            4 => {
                let (from, to) = (below(whole.len()), below(whole.len()));
                let length = 1 + below(whole.len() - from.max(to));
                bytes.copy_within(from..from + length, to);
            }
            // More than there was.
            _ => (0..=below(64)).for_each(|_| bytes.push(below(256) as u8)),
        }
        bytes
    }

    #[test]
    fn of_a_hundred_thousand_damaged_checkpoints_none_is_accepted() {
        let whole = whole();
        let (mut state, mut damaged) = (5, 0);
        while damaged < 100_000 {
            let bytes = damage(&whole, &mut state);
            // Zeros over zeros, or a piece moved onto itself, damage nothing.
            if bytes != whole {
                damaged += 1;
                assert!(decode(&bytes).is_err(), "number {damaged}");
            }
        }
        assert!(decode(&whole).is_ok());
    }
}
