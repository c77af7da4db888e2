//! Figures that the paper prints, m.

/// Table II: state, method, RMS east, north, up.
pub const TABLE_2: [(&str, &str, [f64; 3]); 4] = [
    ("stable", "EKF", [0.58, 0.99, 0.04]),
    ("stable", "FGO", [0.52, 0.86, 0.01]),
    ("complex", "EKF", [17.21, 16.36, 0.35]),
    ("complex", "FGO", [0.73, 0.34, 0.01]),
];

/// Table III: window, method, RMS east, north.
pub const TABLE_3: [(u64, &str, [f64; 2]); 4] = [
    (30, "FGO", [0.87, 0.52]),
    (30, "FGO plus", [0.55, 0.45]),
    (20, "FGO", [0.67, 0.28]),
    (20, "FGO plus", [0.55, 0.45]),
];

/// Table IV, urban38: method, absolute trajectory error.
pub const TABLE_4: [(&str, f64); 5] =
    [("ORB-SLAM3", 105.15), ("SW = 10", 6.16), ("SW = 20", 3.99), ("SW = 50", 9.13), ("SW = 100", 4.49)];

/// Height error of Experiment I-a.
pub const HEIGHT: f64 = 0.015;
