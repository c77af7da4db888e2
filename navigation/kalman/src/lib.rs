//! Kalman filters on the smoother's own models: the baselines that it is compared with (§6 of the method).
//!
//! | file | its question |
//! |---|---|
//! | `estimator.rs` | what does a measurement do to the estimate, and what if it comes late? |
//! | `timeline.rs` | which readings are kept, in which order? |
//! | `update.rs` | what does one sensor say at one instant, does it pass its gate, how much does it count? |
//! | `common_offset.rs` | what do ranges say that share an unknown offset? |
//! | `filter.rs` | the equations of one filter: prediction, (iterated) update in Joseph's form |
//! | `bank.rs` | who runs them: one filter with all sensors |
//! | `federated.rs` | or one a sensor, fused |
//!
//! Noise, lever arms, gates, kernels, first state, preintegration, transport and Earth rotation are those of `nav-models`, as
//! the smoother has them. What a filter has not: a second look at what it has taken in (relinearisation, weights that
//! follow the estimate), and an estimate of the offsets of stamps (a configured one is taken out).

mod bank;
mod common_offset;
mod estimator;
mod federated;
mod filter;
mod timeline;
mod update;

pub use bank::{Bank, Centralised, Stretch};
pub use estimator::{Ekf, FederatedKf, KalmanEstimator};
pub use federated::Federated;
pub use filter::{Diverged, Filter, Linearised};
