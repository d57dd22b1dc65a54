//! `run.mcap`: the run as Foxglove and Rerun show it.
//!
//! Frames of reference: `world` (metres, z up), `camera` in it, and one per joint, named as in the tables. Times are frame
//! numbers over the rate, so that equal runs give equal bytes.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::Context as _;
use body::JointId;
use glam::{DAffine3, DQuat, DVec3};

use super::files::{PendingFile, WriteRunError};
use super::foxglove::{
    CameraCalibration, Color, CompressedImage, FLOAT32, FrameTransform, FrameTransforms, ImageAnnotations,
    LINE_LOOP, LinePrimitive, POINTS, PackedElementField, Point2, PointCloud, PointsAnnotation, Pose,
    PosesInFrame, Quaternion, SCENE_LINE_LIST, SCHEMAS, SceneEntity, SceneUpdate, Timestamp, Topic,
    TriangleListPrimitive, Vector3,
};
use super::record::{Entry, FrameRecord};
use super::scene::{Scene, body_color, bones};
use super::tables::time_s;
use crate::draw::{BODY_OUTLINE_COLOR, MASK_COLOR, Outline};

const WORLD: &str = "world";
const CAMERA: &str = "camera";
const CHUNK_BYTES: u64 = 1 << 20;
const BONE_THICKNESS_M: f64 = 0.012;

/// Writes the file from the journal's entries and the overlays on disk.
pub(super) fn write(
    path: &Path,
    program: &str,
    scene: &Scene,
    fps: f64,
    entries: &[Entry],
    overlay_of: impl Fn(u64) -> std::path::PathBuf,
) -> anyhow::Result<()> {
    let mut file = PendingFile::create(path)?;
    let mut log = Log::start(&mut file, program).map_err(|error| failed(path, error))?;
    for entry in entries {
        let overlay = overlay_of(entry.record.frame);
        let jpeg =
            fs::read(&overlay).with_context(|| format!("{}: cannot read the overlay", overlay.display()))?;
        log.frame(scene, fps, entry, jpeg).map_err(|error| failed(path, error))?;
    }
    log.finish().map_err(|error| failed(path, error))?;
    file.keep()?;
    Ok(())
}

fn failed(path: &Path, error: mcap::McapError) -> WriteRunError {
    let source = match error {
        mcap::McapError::Io(source) => source,
        other => std::io::Error::other(other),
    };
    WriteRunError::file(path)(source)
}

/// A log that messages are put into.
struct Log<'a> {
    writer: mcap::Writer<&'a mut PendingFile>,
    channels: BTreeMap<&'static str, u16>,
    sequence: u32,
}

impl<'a> Log<'a> {
    fn start(file: &'a mut PendingFile, program: &str) -> mcap::McapResult<Self> {
        let options =
            mcap::WriteOptions::new().library(program).compression(None).chunk_size(Some(CHUNK_BYTES));
        Ok(Self { writer: options.create(file)?, channels: BTreeMap::new(), sequence: 0 })
    }

    fn finish(mut self) -> mcap::McapResult<()> {
        self.writer.finish().map(|_| ())
    }

    fn put<T: Topic>(&mut self, topic: &'static str, at: Timestamp, message: &T) -> mcap::McapResult<()> {
        let channel_id = match self.channels.get(topic) {
            Some(&id) => id,
            None => {
                let schema = self.writer.add_schema(T::SCHEMA, "protobuf", SCHEMAS)?;
                let id = self.writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())?;
                self.channels.insert(topic, id);
                id
            }
        };
        let nanoseconds = at.seconds as u64 * 1_000_000_000 + at.nanos as u64;
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: nanoseconds,
            publish_time: nanoseconds,
        };
        self.writer.write_to_known_channel(&header, &message.encode_to_vec())
    }

    fn frame(&mut self, scene: &Scene, fps: f64, entry: &Entry, jpeg: Vec<u8>) -> mcap::McapResult<()> {
        let record = &entry.record;
        let at = timestamp(time_s(record.frame, fps));
        let vertices = scene.vertices_world(&record.pose);
        let image = CompressedImage {
            timestamp: Some(at),
            data: jpeg,
            format: "jpeg".to_owned(),
            frame_id: CAMERA.to_owned(),
        };
        self.put("/tf", at, &transforms(scene, record, at))?;
        self.put("/camera/calibration", at, &calibration(scene, at))?;
        self.put("/camera/overlay", at, &image)?;
        self.put("/camera/annotations", at, &annotations(scene, entry, at))?;
        self.put("/body/joints", at, &joint_poses(scene, record, at))?;
        self.put("/body/points", at, &point_cloud(&vertices, at))?;
        self.put("/body/scene", at, &scene_update(scene, record, &vertices, at))?;
        self.sequence += 1;
        Ok(())
    }
}

fn timestamp(seconds: f64) -> Timestamp {
    let nanoseconds = (seconds * 1e9).round() as i64;
    Timestamp { seconds: nanoseconds / 1_000_000_000, nanos: (nanoseconds % 1_000_000_000) as i32 }
}

fn vector(v: DVec3) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

fn quaternion(q: DQuat) -> Quaternion {
    Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
}

fn pose(frame: &DAffine3) -> Pose {
    Pose {
        position: Some(vector(frame.translation)),
        orientation: Some(quaternion(DQuat::from_mat3(&frame.matrix3).normalize())),
    }
}

fn identity() -> Pose {
    pose(&DAffine3::IDENTITY)
}

fn color(rgb: [u8; 3], alpha: f64) -> Color {
    let [r, g, b] = rgb.map(|value| f64::from(value) / 255.0);
    Color { r, g, b, a: alpha }
}

/// The camera in the world, the pelvis in the world, every other joint in its parent.
fn transforms(scene: &Scene, record: &FrameRecord, at: Timestamp) -> FrameTransforms {
    let transform = |parent: &str, child: &str, parent_from_child: &DAffine3| {
        let placed = pose(parent_from_child);
        FrameTransform {
            timestamp: Some(at),
            parent_frame_id: parent.to_owned(),
            child_frame_id: child.to_owned(),
            translation: placed.position,
            rotation: placed.orientation,
        }
    };
    let world_from_camera = scene.camera.camera_from_world().inverse();
    let world_from_joints = scene.body.world_from_joints(&record.pose);
    let mut transforms = vec![transform(WORLD, CAMERA, &world_from_camera)];
    for joint in JointId::all() {
        let world_from_joint = &world_from_joints[joint.index()];
        transforms.push(match joint.parent() {
            None => transform(WORLD, joint.name(), world_from_joint),
            Some(parent) => {
                let parent_from_world = world_from_joints[parent.index()].inverse();
                transform(parent.name(), joint.name(), &(parent_from_world * *world_from_joint))
            }
        });
    }
    FrameTransforms { transforms }
}

/// The camera of the overlays. Foxglove counts pixels as OpenCV does, from the centre of the first one.
fn calibration(scene: &Scene, at: Timestamp) -> CameraCalibration {
    let intrinsics = scene.camera.intrinsics();
    let [fx, fy] = intrinsics.focal_px;
    let [cx, cy] = intrinsics.principal_point_px.map(|value| value - 0.5);
    CameraCalibration {
        timestamp: Some(at),
        width: intrinsics.width,
        height: intrinsics.height,
        distortion_model: "plumb_bob".to_owned(),
        d: intrinsics.distortion.to_vec(),
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        frame_id: CAMERA.to_owned(),
    }
}

/// Outlines of mask and body, and the joints, in the pixels of the overlay.
fn annotations(scene: &Scene, entry: &Entry, at: Timestamp) -> ImageAnnotations {
    let annotation = |r#type: i32, pixels: &[[f32; 2]], rgb: [u8; 3], thickness: f64| PointsAnnotation {
        timestamp: Some(at),
        r#type,
        points: pixels
            .iter()
            .filter(|pixel| pixel.iter().all(|value| value.is_finite()))
            .map(|[x, y]| Point2 { x: f64::from(*x) - 0.5, y: f64::from(*y) - 0.5 })
            .collect(),
        outline_color: Some(color(rgb, 1.0)),
        fill_color: None,
        thickness,
    };
    let outline = |outline: &Outline, rgb| annotation(LINE_LOOP, outline, rgb, 2.0);
    let mut points: Vec<PointsAnnotation> =
        entry.outlines.mask.iter().map(|mask| outline(mask, MASK_COLOR)).collect();
    points.extend(entry.outlines.body.iter().map(|body| outline(body, BODY_OUTLINE_COLOR)));
    let joints = scene.project(&entry.record.joints_world);
    points.push(annotation(POINTS, &joints, body_color(entry.record.status), 6.0));
    ImageAnnotations { points, timestamp: Some(at) }
}

fn joint_poses(scene: &Scene, record: &FrameRecord, at: Timestamp) -> PosesInFrame {
    let poses = scene.body.world_from_joints(&record.pose).iter().map(pose).collect();
    PosesInFrame { timestamp: Some(at), frame_id: WORLD.to_owned(), poses }
}

fn point_cloud(vertices: &[[f32; 3]], at: Timestamp) -> PointCloud {
    const BYTES: u32 = size_of::<f32>() as u32;
    let field = |(axis, name): (u32, &str)| PackedElementField {
        name: name.to_owned(),
        offset: axis * BYTES,
        r#type: FLOAT32,
    };
    PointCloud {
        timestamp: Some(at),
        frame_id: WORLD.to_owned(),
        pose: Some(identity()),
        point_stride: 3 * BYTES,
        fields: [(0, "x"), (1, "y"), (2, "z")].map(field).to_vec(),
        data: vertices.iter().flatten().flat_map(|value| value.to_le_bytes()).collect(),
    }
}

/// The surface and the bones.
fn scene_update(scene: &Scene, record: &FrameRecord, vertices: &[[f32; 3]], at: Timestamp) -> SceneUpdate {
    let rgb = body_color(record.status);
    let surface = TriangleListPrimitive {
        pose: Some(identity()),
        points: vertices.iter().map(|vertex| vector(DVec3::from_array(vertex.map(f64::from)))).collect(),
        color: Some(color(rgb, 0.55)),
        indices: scene.body.triangles().iter().flatten().copied().collect(),
    };
    let skeleton = LinePrimitive {
        r#type: SCENE_LINE_LIST,
        pose: Some(identity()),
        thickness: BONE_THICKNESS_M,
        scale_invariant: false,
        points: record.joints_world.iter().map(|joint| vector(*joint)).collect(),
        color: Some(color([235, 235, 245], 1.0)),
        indices: bones()
            .flat_map(|(parent, child)| [parent, child])
            .map(|joint| joint.index() as u32)
            .collect(),
    };
    let entity = SceneEntity {
        timestamp: Some(at),
        frame_id: WORLD.to_owned(),
        id: "body".to_owned(),
        frame_locked: true,
        lines: vec![skeleton],
        triangles: vec![surface],
    };
    SceneUpdate { entities: vec![entity] }
}
