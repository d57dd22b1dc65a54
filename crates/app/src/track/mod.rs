//! The tracker: glue of body, silhouettes, scorer and filter.
//!
//! # Map
//! [`clip`] masks of a clip · [`camera_choice`] its camera · [`state`] what is estimated · [`pose_model`], `latent_joints` what poses are likely ·
//! [`overlap`], [`likelihood`] how well a state explains a mask · [`moves`], [`limb`] how particles move · [`start`] where they
//! begin · [`cue`] what the mask alone says · [`travel`] which way they go · [`motion`], [`proposal`] where a frame's particles come from · [`refine`]
//! the last steps to the best pose · [`tracker`] frame after frame · `reading` what several readings of a frame come to ·
//! [`modes`] several trackers side by side · [`learning`] what the predictor makes of it · [`smooth`] what later frames say of
//! it · `doubt` when to try another start · [`follower`] losses and new starts · [`pipeline`] from the input to the run folder

pub mod camera_choice;
pub mod clip;
pub mod cue;
mod doubt;
pub mod follower;
mod latent_joints;
pub mod learning;
pub mod likelihood;
pub mod limb;
pub mod modes;
pub mod motion;
pub mod moves;
pub mod overlap;
pub mod pipeline;
pub mod pose_model;
pub mod proposal;
mod reading;
pub mod refine;
pub mod smooth;
pub mod start;
pub mod state;
pub mod tracker;
pub mod travel;

pub use camera_choice::CameraChoice;
pub use clip::{Background, ClipInput, ClipReader};
pub use pipeline::{NobodyFound, TrackJob, TrackOutcome, track_clip};
