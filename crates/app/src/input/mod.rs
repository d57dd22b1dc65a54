//! Frames and masks from video files and folders.
