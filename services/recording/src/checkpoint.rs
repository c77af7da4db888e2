//! The last solution, kept on disk for the solver that comes after one that died.
//!
//! ```text
//! "ILNSSOLN" | version u32 | CRC-32 of the payload u32 | payload: bincode, fixed-width integers, little endian
//! ```
//!
//! A latched message dies with its sender, so shared memory cannot keep it. Written whole or not at all (a second file, then
//! a rename); read back only if magic, version, length and checksum agree.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};
use shared_types::{Header, Message, SensorCounts, Solution};

use crate::error::LogError;

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
}

/// What is kept of a [`Solution`]; sender and times of publication are not.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Kept {
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
    counts: [(u64, [u64; 15]); 7],
}

fn configuration() -> impl bincode::config::Config {
    bincode::config::standard().with_fixed_int_encoding().with_limit::<LIMIT>()
}

/// The layout that this program writes: that of the message itself.
fn version() -> u32 {
    (Solution::LAYOUT ^ (Solution::LAYOUT >> 32)) as u32
}

/// Writes the solution, whole or not at all.
///
/// # Errors
/// [`LogError::Io`].
pub fn write_checkpoint(file: &Path, solution: &Solution) -> Result<(), LogError> {
    let partial = file.with_extension("partial");
    fs::write(&partial, encode(solution)).map_err(LogError::io(&partial, "write"))?;
    fs::rename(&partial, file).map_err(LogError::io(file, "write"))
}

fn encode(solution: &Solution) -> Vec<u8> {
    let kept = Kept {
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
        counts: solution.counts.map(|counts| (counts.used, counts.rejected)),
    };
    let payload = bincode::serde::encode_to_vec(&kept, configuration()).expect("plain numbers are within the limit");
    let mut bytes = Vec::with_capacity(HEAD + payload.len());
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&version().to_le_bytes());
    bytes.extend_from_slice(&crc32fast::hash(&payload).to_le_bytes());
    bytes.extend_from_slice(&payload);
    bytes
}

/// Reads a solution back; `Ok(None)` where there is no file.
///
/// # Errors
/// [`LogError::Checkpoint`] when the file holds no whole solution of this version, [`LogError::Io`].
pub fn read_checkpoint(file: &Path) -> Result<Option<Solution>, LogError> {
    let bytes = match fs::read(file) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(LogError::io(file, "read")(error)),
    };
    match decode(&bytes) {
        Ok(solution) => Ok(Some(solution)),
        Err(reason) => Err(LogError::Checkpoint { file: file.to_owned(), reason }),
    }
}

fn decode(bytes: &[u8]) -> Result<Solution, CheckpointError> {
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
    let (kept, used): (Kept, usize) =
        bincode::serde::decode_from_slice(payload, configuration()).map_err(|_| CheckpointError::Damaged)?;
    // bincode accepts trailing bytes in silence.
    if used != payload.len() {
        return Err(CheckpointError::Damaged);
    }
    Ok(Solution {
        header: Header { t_valid: kept.t_keyframe, ..Header::default() },
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
        counts: kept.counts.map(|(used, rejected)| SensorCounts { used, rejected }),
        cost: 0.0,
        keyframes: 0,
        iterations: 0,
        linearised: 0,
        status: 0,
        solve_ns: 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solution() -> Solution {
        let mut solution = decode(&encode(&Solution {
            header: Header::default(),
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
            counts: [SensorCounts { used: 9, rejected: [3; 15] }; 7],
            cost: 0.0,
            keyframes: 0,
            iterations: 0,
            linearised: 0,
            status: 0,
            solve_ns: 0,
        }))
        .expect("it was just encoded");
        solution.covariance[3][4] = -0.125;
        solution
    }

    #[test]
    fn a_solution_is_read_back_to_the_bit() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("solution");
        assert_eq!(read_checkpoint(&file).expect("no file is no error"), None);
        write_checkpoint(&file, &solution()).expect("it can be written");
        write_checkpoint(&file, &solution()).expect("it can be replaced");
        assert_eq!(read_checkpoint(&file).expect("it can be read"), Some(solution()));
    }

    #[test]
    fn no_flipped_bit_and_no_torn_end_is_ever_taken_for_a_solution() {
        let whole = encode(&solution());
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
}
