//! Which file holds which reading, under which columns.
//!
//! A recording made live has further columns: `t_arrival` and `sequence` in every sensor file, `in_epoch` in `lbl.csv` and
//! `moored` in `buoys.csv`. The last two are what the sender said; from rows alone they would be guessed, and a lost
//! range or a repeated fix of a moored buoy would make the replay differ from what happened.

use shared_types::{BuoyFix, DvlVelocity, GnssFix, Header, ImuSample, LblRange, McpHeading, PsDepth, Time, Truth};

use crate::decimal;
use crate::error::LogError;
use crate::table::{Columns, Row};

/// A reading that has a file of its own in the log directory.
pub trait LogRow: Sized {
    /// `imu.csv`, ...
    const FILE: &'static str;
    /// Columns of the format; the first is `t`.
    const COLUMNS: &'static [&'static str];
    /// Columns that only a recording has: `t_arrival`, `sequence`, and what else the sender said.
    const RECORDED: &'static [&'static str];

    /// Everything but the header; `header` is taken over.
    #[doc(hidden)]
    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError>;
    /// The header.
    #[doc(hidden)]
    fn header(&self) -> &Header;
    /// Cells after `t`, each with its comma in front.
    #[doc(hidden)]
    fn push_cells(&self, text: &mut Vec<u8>);
    /// Cells of [`LogRow::RECORDED`] after `t_arrival,sequence`.
    #[doc(hidden)]
    fn push_recorded(&self, _text: &mut Vec<u8>) {}
}

/// Index of `t`.
const T: usize = 0;

pub(crate) fn columns_of<T: LogRow>() -> Columns {
    Columns { required: T::COLUMNS, optional: T::RECORDED }
}

pub(crate) fn t_arrival_column<T: LogRow>() -> usize {
    T::COLUMNS.len()
}

/// First recorded column after `t_arrival,sequence`.
pub(crate) fn said_column<T: LogRow>() -> usize {
    T::COLUMNS.len() + 2
}

/// Header of a row: `t`, and arrival and order where they were recorded; `counted` stands in for the order.
pub(crate) fn parse_header<R: LogRow>(row: &Row<'_>, has_arrival: bool, counted: u64) -> Result<Header, LogError> {
    let mut header = Header { sequence: counted, ..Header::at(row.time(T)?) };
    if R::RECORDED.is_empty() {
        return Ok(header);
    }
    let arrival = t_arrival_column::<R>();
    if has_arrival {
        header.t_arrival = row.time(arrival)?.0;
    }
    if let Some(sequence) = row.whole(arrival + 1)? {
        header.sequence = sequence;
    }
    Ok(header)
}

/// A whole row of text, line end included.
pub(crate) fn push_row<R: LogRow>(text: &mut Vec<u8>, row: &R, arrival_columns: bool) {
    let header = row.header();
    decimal::push_time(text, Time(header.t_valid));
    row.push_cells(text);
    if arrival_columns && !R::RECORDED.is_empty() {
        text.push(b',');
        decimal::push_time(text, Time(header.t_arrival));
        push_whole(text, header.sequence);
        row.push_recorded(text);
    }
    text.push(b'\n');
}

fn push_whole(text: &mut Vec<u8>, value: u64) {
    text.push(b',');
    text.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

fn push_numbers(text: &mut Vec<u8>, values: &[f64]) {
    for &value in values {
        text.push(b',');
        decimal::push_shortest(text, value);
    }
}

impl LogRow for ImuSample {
    const FILE: &'static str = "imu.csv";
    const COLUMNS: &'static [&'static str] = &["t", "wx", "wy", "wz", "fx", "fy", "fz"];
    const RECORDED: &'static [&'static str] = &["t_arrival", "sequence"];

    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        Ok(ImuSample { header, gyro_body: row.numbers(1)?, accel_body: row.numbers(4)? })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_numbers(text, &self.gyro_body);
        push_numbers(text, &self.accel_body);
    }
}

impl LogRow for LblRange {
    const FILE: &'static str = "lbl.csv";
    const COLUMNS: &'static [&'static str] = &["t", "buoy", "range"];
    const RECORDED: &'static [&'static str] = &["t_arrival", "sequence", "in_epoch"];

    /// Without the column, `in_epoch` is 0; [`crate::LblReader`] counts.
    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        let in_epoch = match row.whole(said_column::<LblRange>())? {
            None => 0,
            Some(_) => row.index(said_column::<LblRange>())?,
        };
        Ok(LblRange { header, buoy: row.index(1)?, in_epoch, range: row.number(2)? })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_whole(text, self.buoy.into());
        push_numbers(text, &[self.range]);
    }

    fn push_recorded(&self, text: &mut Vec<u8>) {
        push_whole(text, self.in_epoch.into());
    }
}

impl LogRow for BuoyFix {
    const FILE: &'static str = "buoys.csv";
    const COLUMNS: &'static [&'static str] = &["t", "buoy", "lat", "lon", "h"];
    const RECORDED: &'static [&'static str] = &["t_arrival", "sequence", "moored"];

    /// Without the column, `moored` is 0; [`crate::BuoyReader`] knows who has a single row.
    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        let moored = u32::from(row.whole(said_column::<BuoyFix>())?.unwrap_or(0) != 0);
        let [lat_deg, lon_deg, height] = row.numbers(2)?;
        Ok(BuoyFix { header, buoy: row.index(1)?, moored, lat_deg, lon_deg, height })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_whole(text, self.buoy.into());
        push_numbers(text, &[self.lat_deg, self.lon_deg, self.height]);
    }

    fn push_recorded(&self, text: &mut Vec<u8>) {
        push_whole(text, self.moored.into());
    }
}

impl LogRow for GnssFix {
    const FILE: &'static str = "gnss.csv";
    const COLUMNS: &'static [&'static str] = &["t", "lat", "lon", "h", "se", "sn", "su"];
    const RECORDED: &'static [&'static str] = &["t_arrival", "sequence"];

    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        let [lat_deg, lon_deg, height] = row.numbers(1)?;
        Ok(GnssFix { header, lat_deg, lon_deg, height, sigma_enu: row.numbers(4)? })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_numbers(text, &[self.lat_deg, self.lon_deg, self.height]);
        push_numbers(text, &self.sigma_enu);
    }
}

impl LogRow for DvlVelocity {
    const FILE: &'static str = "dvl.csv";
    const COLUMNS: &'static [&'static str] = &["t", "vx", "vy", "vz"];
    const RECORDED: &'static [&'static str] = &["t_arrival", "sequence"];

    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        Ok(DvlVelocity { header, velocity_dvl: row.numbers(1)? })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_numbers(text, &self.velocity_dvl);
    }
}

impl LogRow for McpHeading {
    const FILE: &'static str = "mcp.csv";
    const COLUMNS: &'static [&'static str] = &["t", "heading"];
    const RECORDED: &'static [&'static str] = &["t_arrival", "sequence"];

    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        Ok(McpHeading { header, heading_deg: row.number(1)? })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_numbers(text, &[self.heading_deg]);
    }
}

impl LogRow for PsDepth {
    const FILE: &'static str = "ps.csv";
    const COLUMNS: &'static [&'static str] = &["t", "depth"];
    const RECORDED: &'static [&'static str] = &["t_arrival", "sequence"];

    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        Ok(PsDepth { header, depth: row.number(1)? })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_numbers(text, &[self.depth]);
    }
}

/// The truth is no sensor: it has no columns of arrival.
impl LogRow for Truth {
    const FILE: &'static str = "truth.csv";
    const COLUMNS: &'static [&'static str] = &["t", "lat", "lon", "h", "qw", "qx", "qy", "qz", "ve", "vn", "vu"];
    const RECORDED: &'static [&'static str] = &[];

    fn parse(row: &Row<'_>, header: Header) -> Result<Self, LogError> {
        let [lat_deg, lon_deg, height] = row.numbers(1)?;
        Ok(Truth { header, lat_deg, lon_deg, height, q_enu_body: row.numbers(4)?, velocity_enu: row.numbers(8)? })
    }

    fn header(&self) -> &Header {
        &self.header
    }

    fn push_cells(&self, text: &mut Vec<u8>) {
        push_numbers(text, &[self.lat_deg, self.lon_deg, self.height]);
        push_numbers(text, &self.q_enu_body);
        push_numbers(text, &self.velocity_enu);
    }
}
