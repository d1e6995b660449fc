//! Fits and what they are made of: the loop, losses, regularizers, schedules, modules.

#[path = "../common/mod.rs"]
mod common;
mod parameters;

mod backends;
mod devices;
mod dmtet;
mod fit_settings;
mod large_steps;
mod least_squares;
mod losses;
mod mesh_losses;
mod mistakes;
mod module_configs;
mod module_files;
mod module_gradients;
mod modules;
mod output;
#[cfg(feature = "photographs")]
mod photographs;
mod point_clouds;
#[cfg(feature = "photographs")]
mod poses;
mod run;
mod schedule;
mod similarity;
