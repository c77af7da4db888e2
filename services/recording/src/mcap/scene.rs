//! Buoys and the 95 % ellipse as a scene for 3D views.
//!
//! ```text
//! ellipse(phi) = position_en + k L (cos phi, sin phi)^T,   L L^T = covariance of east and north,   k^2 = 5.991
//! ```
//!
//! k² is the 95 % quantile of chi-square with two degrees of freedom; with the Cholesky factor no eigenvector is needed.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, NavEstimate};

use super::json::Object;
use super::messages::MAP;

/// Square root of the 95 % quantile of chi-square with two degrees of freedom.
const K_95: f64 = 2.447_746_83;
/// Corners of the line that is drawn for an ellipse.
const CORNERS: usize = 48;
/// Diameter of a buoy in the view, m: to be seen from some hundred metres.
const BUOY_SIZE: f64 = 4.0;
/// Blue and orange that the colour-blind tell apart; red, green, blue, opacity.
const ELLIPSE_COLOR: [f64; 4] = [0.0, 0.447, 0.698, 1.0];
const BUOY_COLOR: [f64; 4] = [0.902, 0.624, 0.0, 1.0];

/// Points of the 95 % ellipse about the estimate, east, north, up, m.
pub(crate) fn ellipse(estimate: &NavEstimate) -> Vec<[f64; 3]> {
    let [east, north, up] = estimate.position_enu;
    let [ee, en, _, nn, ..] = estimate.position_cov;
    let l_ee = ee.max(0.0).sqrt();
    let l_ne = if l_ee > 0.0 { en / l_ee } else { 0.0 };
    let l_nn = (nn - l_ne * l_ne).max(0.0).sqrt();
    let corner = |index: usize| {
        let (sin, cos) = (TAU * index as f64 / CORNERS as f64).sin_cos();
        [east + K_95 * l_ee * cos, north + K_95 * (l_ne * cos + l_nn * sin), up]
    };
    (0..CORNERS).map(corner).collect()
}

/// The whole scene; each entity replaces the one of the same id.
pub(crate) fn update(text: &mut Vec<u8>, estimate: &NavEstimate, frame: &LocalFrame, buoys: &BTreeMap<u32, BuoyFix>) {
    let t = estimate.header.t_valid;
    let places: Vec<(u32, [f64; 3])> = buoys
        .values()
        .map(|buoy| {
            let place = frame.to_enu(&Geodetic::from_degrees(buoy.lat_deg, buoy.lon_deg, buoy.height));
            (buoy.buoy, [place.x, place.y, place.z])
        })
        .filter(|(_, place)| place.iter().all(|value| value.is_finite()))
        .collect();
    Object::write(text, |scene| {
        scene.list("deletions", [(); 0], |_, ()| {});
        scene.list("entities", ["ellipse", "buoys"], |entity, id| {
            entity.stamp("timestamp", t);
            entity.word("frame_id", MAP);
            entity.word("id", id);
            entity.stamp("lifetime", 0);
            entity.truth("frame_locked", false);
            entity.list("metadata", [(); 0], |_, ()| {});
            let (spheres, lines) = if id == "buoys" { (&places[..], None) } else { (&[][..], Some(ellipse(estimate))) };
            entity.list("spheres", spheres, |sphere, (_, place)| {
                pose(sphere, *place);
                sphere.object("size", |size| size.numbers(["x", "y", "z"], [BUOY_SIZE; 3]));
                color(sphere, BUOY_COLOR);
            });
            entity.list("lines", lines, |line, points| {
                line.whole("type", 1);
                pose(line, [0.0; 3]);
                line.number("thickness", 2.0);
                line.truth("scale_invariant", true);
                line.list("points", points, |point, place| point.numbers(["x", "y", "z"], place));
                color(line, ELLIPSE_COLOR);
                line.array("colors", &[]);
                line.array("indices", &[]);
            });
            entity.list("texts", spheres, |label, &(buoy, [east, north, up])| {
                pose(label, [east, north, up + BUOY_SIZE]);
                label.truth("billboard", true);
                label.number("font_size", 14.0);
                label.truth("scale_invariant", true);
                color(label, BUOY_COLOR);
                label.word("text", &format!("buoy {buoy}"));
            });
        });
    });
}

fn pose(object: &mut Object<'_>, position: [f64; 3]) {
    object.object("pose", |pose| {
        pose.object("position", |object| object.numbers(["x", "y", "z"], position));
        pose.object("orientation", |object| object.numbers(["x", "y", "z", "w"], [0.0, 0.0, 0.0, 1.0]));
    });
}

fn color(object: &mut Object<'_>, color: [f64; 4]) {
    object.object("color", |object| object.numbers(["r", "g", "b", "a"], color));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::estimate;

    #[test]
    fn every_corner_of_the_ellipse_is_as_many_sigmas_away() {
        let mut estimate = estimate(1.0);
        // Tilted: the correlation is 0.5.
        estimate.position_cov = [4.0, 3.0, 0.0, 9.0, 0.0, 1.0];
        let determinant = 4.0 * 9.0 - 3.0 * 3.0;
        for [east, north, up] in ellipse(&estimate) {
            let (de, dn) = (east - estimate.position_enu[0], north - estimate.position_enu[1]);
            let squared = (9.0 * de * de - 6.0 * de * dn + 4.0 * dn * dn) / determinant;
            assert!((squared - 5.991_464_5).abs() < 1e-6, "{squared}");
            assert_eq!(up, estimate.position_enu[2]);
        }
    }
}
