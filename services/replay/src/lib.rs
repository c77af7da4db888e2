//! A log directory through the whole navigator, without processes; scores and pictures.
