//! The Foxglove messages that `run.mcap` holds, field by field as in the published definitions.
//!
//! `assets/foxglove-schemas.bin` is the `google.protobuf.FileDescriptorSet` of these messages and all they refer to, taken
//! from version 0.4.0 of the Python package `foxglove-schemas-protobuf` (MIT). A test holds the fields below against it.

use prost::Message;

/// The definitions of all messages, serialized.
pub(super) const SCHEMAS: &[u8] = include_bytes!("../../assets/foxglove-schemas.bin");

/// A message with a schema of its own in a file.
pub(super) trait Topic: Message {
    /// Full name of the message type.
    const SCHEMA: &'static str;
}

macro_rules! topics {
    ($($message:ident),*) => {
        $(impl Topic for $message { const SCHEMA: &'static str = concat!("foxglove.", stringify!($message)); })*
    };
}
topics!(
    CameraCalibration,
    CompressedImage,
    FrameTransforms,
    ImageAnnotations,
    PointCloud,
    PosesInFrame,
    SceneUpdate
);

/// `google.protobuf.Timestamp`
#[derive(Clone, Copy, PartialEq, Message)]
pub(super) struct Timestamp {
    #[prost(int64, tag = "1")]
    pub seconds: i64,
    #[prost(int32, tag = "2")]
    pub nanos: i32,
}

/// `foxglove.Vector3`, and `foxglove.Point3`, which has the same fields.
#[derive(Clone, Copy, PartialEq, Message)]
pub(super) struct Vector3 {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(super) struct Point2 {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(super) struct Quaternion {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
    #[prost(double, tag = "4")]
    pub w: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(super) struct Pose {
    #[prost(message, optional, tag = "1")]
    pub position: Option<Vector3>,
    #[prost(message, optional, tag = "2")]
    pub orientation: Option<Quaternion>,
}

/// Parts of 1.
#[derive(Clone, Copy, PartialEq, Message)]
pub(super) struct Color {
    #[prost(double, tag = "1")]
    pub r: f64,
    #[prost(double, tag = "2")]
    pub g: f64,
    #[prost(double, tag = "3")]
    pub b: f64,
    #[prost(double, tag = "4")]
    pub a: f64,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct CameraCalibration {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(fixed32, tag = "2")]
    pub width: u32,
    #[prost(fixed32, tag = "3")]
    pub height: u32,
    #[prost(string, tag = "4")]
    pub distortion_model: String,
    /// Distortion coefficients.
    #[prost(double, repeated, tag = "5")]
    pub d: Vec<f64>,
    /// 3 x 3 intrinsic matrix, row by row.
    #[prost(double, repeated, tag = "6")]
    pub k: Vec<f64>,
    /// 3 x 3 rectification.
    #[prost(double, repeated, tag = "7")]
    pub r: Vec<f64>,
    /// 3 x 4 projection.
    #[prost(double, repeated, tag = "8")]
    pub p: Vec<f64>,
    #[prost(string, tag = "9")]
    pub frame_id: String,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct CompressedImage {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(bytes = "vec", tag = "2")]
    pub data: Vec<u8>,
    #[prost(string, tag = "3")]
    pub format: String,
    #[prost(string, tag = "4")]
    pub frame_id: String,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct FrameTransform {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub parent_frame_id: String,
    #[prost(string, tag = "3")]
    pub child_frame_id: String,
    #[prost(message, optional, tag = "4")]
    pub translation: Option<Vector3>,
    #[prost(message, optional, tag = "5")]
    pub rotation: Option<Quaternion>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct FrameTransforms {
    #[prost(message, repeated, tag = "1")]
    pub transforms: Vec<FrameTransform>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct PosesInFrame {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(message, repeated, tag = "3")]
    pub poses: Vec<Pose>,
}

/// `foxglove.PackedElementField.NumericType` of `f32`.
pub(super) const FLOAT32: i32 = 7;

#[derive(Clone, PartialEq, Message)]
pub(super) struct PackedElementField {
    #[prost(string, tag = "1")]
    pub name: String,
    #[prost(fixed32, tag = "2")]
    pub offset: u32,
    /// An enumeration, which has the form of an `int32`.
    #[prost(int32, tag = "3")]
    pub r#type: i32,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct PointCloud {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(message, optional, tag = "3")]
    pub pose: Option<Pose>,
    #[prost(fixed32, tag = "4")]
    pub point_stride: u32,
    #[prost(message, repeated, tag = "5")]
    pub fields: Vec<PackedElementField>,
    #[prost(bytes = "vec", tag = "6")]
    pub data: Vec<u8>,
}

/// `foxglove.LinePrimitive.Type.LINE_LIST`
pub(super) const SCENE_LINE_LIST: i32 = 2;

#[derive(Clone, PartialEq, Message)]
pub(super) struct LinePrimitive {
    #[prost(int32, tag = "1")]
    pub r#type: i32,
    #[prost(message, optional, tag = "2")]
    pub pose: Option<Pose>,
    #[prost(double, tag = "3")]
    pub thickness: f64,
    #[prost(bool, tag = "4")]
    pub scale_invariant: bool,
    #[prost(message, repeated, tag = "5")]
    pub points: Vec<Vector3>,
    #[prost(message, optional, tag = "6")]
    pub color: Option<Color>,
    #[prost(fixed32, repeated, tag = "8")]
    pub indices: Vec<u32>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct TriangleListPrimitive {
    #[prost(message, optional, tag = "1")]
    pub pose: Option<Pose>,
    #[prost(message, repeated, tag = "2")]
    pub points: Vec<Vector3>,
    #[prost(message, optional, tag = "3")]
    pub color: Option<Color>,
    #[prost(fixed32, repeated, tag = "5")]
    pub indices: Vec<u32>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct SceneEntity {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(string, tag = "3")]
    pub id: String,
    #[prost(bool, tag = "5")]
    pub frame_locked: bool,
    #[prost(message, repeated, tag = "11")]
    pub lines: Vec<LinePrimitive>,
    #[prost(message, repeated, tag = "12")]
    pub triangles: Vec<TriangleListPrimitive>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct SceneUpdate {
    #[prost(message, repeated, tag = "2")]
    pub entities: Vec<SceneEntity>,
}

/// `foxglove.PointsAnnotation.Type.LINE_LOOP`
pub(super) const LINE_LOOP: i32 = 2;
/// `foxglove.PointsAnnotation.Type.POINTS`
pub(super) const POINTS: i32 = 1;

#[derive(Clone, PartialEq, Message)]
pub(super) struct PointsAnnotation {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(int32, tag = "2")]
    pub r#type: i32,
    #[prost(message, repeated, tag = "3")]
    pub points: Vec<Point2>,
    #[prost(message, optional, tag = "4")]
    pub outline_color: Option<Color>,
    #[prost(message, optional, tag = "6")]
    pub fill_color: Option<Color>,
    #[prost(double, tag = "7")]
    pub thickness: f64,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct ImageAnnotations {
    #[prost(message, repeated, tag = "2")]
    pub points: Vec<PointsAnnotation>,
    #[prost(message, optional, tag = "5")]
    pub timestamp: Option<Timestamp>,
}

#[cfg(test)]
mod tests;
