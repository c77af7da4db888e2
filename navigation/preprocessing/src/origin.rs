//! Where is the frame?
//!
//! The origin of the ENU frame is configured (`frame.origin`), or it is the first accepted satellite fix, with the height
//! of the mean surface where the fix has none. Once fixed it never moves. A switched-off receiver may still place the
//! frame: that chooses coordinates, it corrects nothing.
//!
//! The frame is always made from the degrees that are published, so that every process and every restart has the same
//! bits.

use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Frame, FrameOrigin, Header, Time};

/// An origin that is no place on Earth.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the origin of the frame is said to be at latitude {lat_deg} deg, longitude {lon_deg} deg, height {height} m")]
pub struct OriginError {
    lat_deg: f64,
    lon_deg: f64,
    height: f64,
}

/// The frame, once it is known.
#[derive(Clone, Debug)]
pub(crate) struct Origin {
    surface_height: f64,
    fixed: Option<(FrameOrigin, LocalFrame)>,
}

impl Origin {
    pub(crate) fn new(frame: &Frame) -> Origin {
        let mut origin = Origin { surface_height: frame.surface_height, fixed: None };
        if let Some([latitude, longitude, height]) = frame.origin_geodetic {
            let [lat_deg, lon_deg] = [latitude, longitude].map(degrees_as_written);
            origin.fix(FrameOrigin { header: Header::default(), lat_deg, lon_deg, height });
        }
        origin
    }

    /// Fixes the frame where an earlier start of this run had it.
    ///
    /// # Errors
    /// [`OriginError`] where that is no place on Earth.
    pub(crate) fn restore(&mut self, origin: FrameOrigin) -> Result<(), OriginError> {
        let FrameOrigin { lat_deg, lon_deg, height, .. } = origin;
        if lat_deg.abs() <= 90.0 && lon_deg.abs() <= 360.0 && height.is_finite() {
            self.fix(origin);
            Ok(())
        } else {
            Err(OriginError { lat_deg, lon_deg, height })
        }
    }

    fn fix(&mut self, origin: FrameOrigin) {
        let geodetic = Geodetic::from_degrees(origin.lat_deg, origin.lon_deg, origin.height);
        self.fixed = Some((origin, LocalFrame::new(geodetic)));
    }

    /// The frame; an accepted fix at `t` makes it if there is none.
    pub(crate) fn frame_or_fix(&mut self, t: Time, lat_deg: f64, lon_deg: f64, height: Option<f64>) -> &LocalFrame {
        if self.fixed.is_none() {
            let height = height.unwrap_or(self.surface_height);
            self.fix(FrameOrigin { header: Header::at(t), lat_deg, lon_deg, height });
        }
        &self.fixed.as_ref().expect("it was fixed in the line before").1
    }

    pub(crate) fn frame(&self) -> Option<&LocalFrame> {
        self.fixed.as_ref().map(|(_, frame)| frame)
    }

    pub(crate) fn published(&self) -> Option<FrameOrigin> {
        self.fixed.map(|(origin, _)| origin)
    }
}

/// Degrees of a configured angle as they were written, without the rounding of the way to radians and back: thirteen
/// decimals are 10 nm and still exact in an `f64`.
fn degrees_as_written(angle: f64) -> f64 {
    (angle.to_degrees() * 1e13).round() / 1e13
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Vehicle;

    #[test]
    fn the_first_fix_makes_the_frame_and_the_second_does_not_move_it() {
        let mut origin = Origin::new(&Vehicle::default().frame);
        assert!(origin.frame().is_none());
        origin.frame_or_fix(Time(5), 36.0, 127.0, Some(12.0));
        origin.frame_or_fix(Time(6), 37.0, 128.0, Some(13.0));
        let published = origin.published().expect("fixed");
        assert_eq!((published.lat_deg, published.lon_deg, published.height), (36.0, 127.0, 12.0));
        assert_eq!(published.header.t_valid, 5);
    }

    #[test]
    fn a_fix_without_height_puts_the_origin_on_the_surface() {
        let mut origin = Origin::new(&Frame { origin_geodetic: None, surface_height: 41.5 });
        origin.frame_or_fix(Time(5), 36.0, 127.0, None);
        assert_eq!(origin.published().expect("fixed").height, 41.5);
    }

    #[test]
    fn a_restart_from_the_published_origin_has_the_same_frame_to_the_bit() {
        let configured = Origin::new(&Frame { origin_geodetic: Some([0.634, 2.222, 3.0]), surface_height: 0.0 });
        let mut restarted = Origin::new(&Vehicle::default().frame);
        assert_eq!(restarted.restore(configured.published().expect("configured")), Ok(()));
        assert_eq!(restarted.frame(), configured.frame());
    }

    #[test]
    fn an_origin_that_is_no_place_is_refused() {
        let mut origin = Origin::new(&Vehicle::default().frame);
        let nowhere = FrameOrigin { header: Header::default(), lat_deg: f64::NAN, lon_deg: 0.0, height: 0.0 };
        assert!(origin.restore(nowhere).is_err());
        assert!(origin.frame().is_none());
    }

    #[test]
    fn a_configured_origin_is_published_as_it_was_written() {
        for (lat_deg, lon_deg) in [(36.38, 127.0), (63.441588667, 10.417852333), (-45.5177731305, -73.3932946744)] {
            let origin_geodetic = Some([f64::to_radians(lat_deg), f64::to_radians(lon_deg), 0.0]);
            let published = Origin::new(&Frame { origin_geodetic, surface_height: 0.0 }).published().expect("given");
            assert_eq!((published.lat_deg, published.lon_deg), (lat_deg, lon_deg));
        }
    }
}
