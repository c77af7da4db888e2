//! What stands beside the chain of a window: the columns of the systematic errors and of the moored buoys.

use nav_models::wide;

use super::Window;
use crate::columns::{Before, Score, TERMS, fading};
use crate::interval::{ImuHistory, ImuModel};
use crate::kernels::{Block, BlockVector};
use crate::moorings::{self, StatesByPosition};
use crate::node::Node;
use crate::rows::DIM;
use crate::systematic::Correction;

/// Readings of which less than this share of an error would be taken stay as they are.
const SHIFT_SHARE_MIN: f64 = 1e-3;

impl Window {
    /// Covariances cover that the positions of moored buoys are off by so much, 1-sigma of an axis in m.
    pub fn consider_moorings(&mut self, sigma: f64) {
        self.mooring_sigma = sigma;
        if self.considers_moorings() {
            self.mooring_prior.reserve();
        }
    }

    /// Whether anything is to be covered of them.
    pub fn considers_moorings(&self) -> bool {
        self.mooring_sigma > 0.0
    }

    /// Takes a systematic error out of the readings, less of it the older they are, as one memory of `columns` has it; the
    /// next solve is over the whole window.
    pub fn correct(&mut self, correction: &Correction, history: &ImuHistory, imu: &ImuModel) {
        let Correction { error, by, term } = *correction;
        let Some(newest) = self.nodes.back().map(|node| node.t) else { return };
        let world = self.world;
        for (index, node) in self.nodes.iter_mut().enumerate() {
            let share = fading(newest - node.t, term);
            // Only a batch reaches that far back.
            if share > SHIFT_SHARE_MIN {
                self.costs[index] = node.correct(error, by * share, history, imu, &world);
                self.dirty = self.dirty.min(index);
                self.uncounted = self.uncounted.min(index);
            }
        }
        if let Some(oldest) = self.nodes.front() {
            let share = fading(newest - oldest.t, term);
            if share > SHIFT_SHARE_MIN {
                self.column_prior.shift(error, term, by * share, &mut self.prior.right);
            }
        }
    }

    /// Brings the columns of the systematic errors and of the moored buoys to the last solve.
    pub fn sweep_columns(&mut self) {
        let considers_moorings = self.considers_moorings();
        let nodes = self.nodes.make_contiguous();
        for index in self.columns_behind..nodes.len() {
            let (before, rest) = nodes.split_at_mut(index);
            let Node { t, rows, link, columns, moorings, .. } = &mut *rest[0];
            let earlier = before.last().map(|earlier| (earlier, *t - earlier.t));
            let before = earlier.map_or(Before::Prior(&self.column_prior), |(earlier, dt)| {
                Before::Link(&earlier.columns, &earlier.link, dt)
            });
            wide!(columns.sweep(link, &rows.assemble_slopes(), before));
            if considers_moorings {
                let before = earlier.map_or(moorings::Before::Prior(&self.mooring_prior), |(earlier, dt)| {
                    moorings::Before::Link(&earlier.moorings, &earlier.link, dt)
                });
                wide!({
                    moorings.clear();
                    rows.assemble_moorings(moorings);
                    moorings.sweep(link, columns, before);
                });
            }
        }
        self.columns_behind = nodes.len();
    }

    /// Adds to the covariance of a keyframe what the positions of the moored buoys may be off by, as of [`Window::sweep_columns`].
    /// `states` comes from the keyframe after it, or is empty at the newest.
    pub fn cover_moorings(&self, node: &Node, states: &mut StatesByPosition, covariance: &mut Block<DIM>) {
        if self.considers_moorings() {
            wide!({
                node.moorings.carry_back(&node.link, states);
                states.cover(self.mooring_sigma, covariance);
            });
        }
    }

    /// What each memory says of a systematic error, as of [`Window::sweep_columns`].
    pub fn score(&self, error: usize) -> [Score; TERMS] {
        let Some(newest) = self.nodes.back() else { return [Score::default(); TERMS] };
        let scores = newest.columns.of(error);
        let variance = self.mooring_sigma * self.mooring_sigma;
        core::array::from_fn(|term| scores[term].in_doubt(variance * newest.moorings.variance_of(error, term)))
    }

    /// How far the newest state is off per unit of a systematic error.
    pub fn state_by_error(&self, error: usize, term: usize) -> BlockVector<DIM> {
        self.nodes
            .back()
            .map_or(BlockVector::zeros(), |newest| newest.columns.state_by_error(&newest.link, error, term))
    }
}
