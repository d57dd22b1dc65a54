use std::collections::{BTreeMap, BTreeSet};

use prost::Message;

use super::*;

/// The part of `google.protobuf.FileDescriptorSet` that the check reads.
#[derive(Clone, PartialEq, Message)]
struct DescriptorSet {
    #[prost(message, repeated, tag = "1")]
    file: Vec<FileDescriptor>,
}

#[derive(Clone, PartialEq, Message)]
struct FileDescriptor {
    #[prost(string, tag = "2")]
    package: String,
    #[prost(message, repeated, tag = "4")]
    message_type: Vec<MessageDescriptor>,
}

#[derive(Clone, PartialEq, Message)]
struct MessageDescriptor {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, repeated, tag = "2")]
    field: Vec<FieldDescriptor>,
}

#[derive(Clone, PartialEq, Message)]
struct FieldDescriptor {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int32, tag = "3")]
    number: i32,
    #[prost(int32, tag = "4")]
    label: i32,
    #[prost(int32, tag = "5")]
    r#type: i32,
    #[prost(string, tag = "6")]
    type_name: String,
}

type Messages = BTreeMap<String, BTreeMap<u32, FieldDescriptor>>;

fn published() -> Messages {
    let set = DescriptorSet::decode(SCHEMAS).unwrap();
    let messages = set.file.into_iter().flat_map(|file| {
        let package = file.package;
        file.message_type
            .into_iter()
            .map(move |message| (format!(".{package}.{}", message.name), message.field))
    });
    messages
        .map(|(name, fields)| (name, fields.into_iter().map(|field| (field.number as u32, field)).collect()))
        .collect()
}

fn varint(bytes: &mut &[u8]) -> u64 {
    let (mut value, mut shift) = (0, 0);
    loop {
        let (first, rest) = bytes.split_first().expect("a varint is cut off");
        *bytes = rest;
        value |= u64::from(first & 0x7f) << shift;
        shift += 7;
        if first & 0x80 == 0 {
            return value;
        }
    }
}

/// Walks an encoded message and holds every field against the definition; adds what it met to `met`.
fn check(
    messages: &Messages,
    type_name: &str,
    mut bytes: &[u8],
    met: &mut BTreeSet<(String, u32)>,
) -> Result<(), String> {
    let fields = messages.get(type_name).ok_or_else(|| format!("{type_name} is not defined"))?;
    while !bytes.is_empty() {
        let key = varint(&mut bytes);
        let (number, wire) = ((key >> 3) as u32, key & 7);
        let field = fields.get(&number).ok_or_else(|| format!("{type_name} has no field {number}"))?;
        met.insert((type_name.to_owned(), number));
        let is_repeated = field.label == 3;
        // Types of `FieldDescriptorProto` and their wire types; repeated numbers are packed.
        let expected = match field.r#type {
            1 | 7 | 8 | 14 if is_repeated => 2,
            1 => 1,
            7 => 5,
            3 | 5 | 8 | 14 => 0,
            9 | 11 | 12 => 2,
            other => return Err(format!("{type_name}.{}: type {other} is not used here", field.name)),
        };
        if wire != expected {
            return Err(format!("{type_name}.{}: wire type {wire}, expected {expected}", field.name));
        }
        let length = match wire {
            0 => {
                varint(&mut bytes);
                0
            }
            1 => 8,
            5 => 4,
            _ => varint(&mut bytes) as usize,
        };
        let (content, rest) = bytes.split_at(length);
        bytes = rest;
        let element = match field.r#type {
            1 => 8,
            7 => 4,
            11 => {
                check(messages, &field.type_name, content, met)?;
                1
            }
            _ => 1,
        };
        if wire == 2 && length % element != 0 {
            return Err(format!("{type_name}.{}: {length} bytes are not whole elements", field.name));
        }
    }
    Ok(())
}

fn met_fields<T: Topic>(message: &T) -> Result<BTreeSet<(String, u32)>, String> {
    let mut met = BTreeSet::new();
    check(&published(), &format!(".{}", T::SCHEMA), &message.encode_to_vec(), &mut met)?;
    Ok(met)
}

const AT: Option<Timestamp> = Some(Timestamp { seconds: 3, nanos: 4 });
const POINT: Vector3 = Vector3 { x: 1.0, y: 2.0, z: 3.0 };
const TURN: Quaternion = Quaternion { x: 0.1, y: 0.2, z: 0.3, w: 0.9 };
const PLACED: Option<Pose> = Some(Pose { position: Some(POINT), orientation: Some(TURN) });
const TINT: Option<Color> = Some(Color { r: 0.1, g: 0.2, b: 0.3, a: 0.4 });

fn text() -> String {
    "text".to_owned()
}

/// Every field of every message, none at its default, which would not be written.
#[test]
fn messages_match_the_published_definitions() {
    let calibration = CameraCalibration {
        timestamp: AT,
        width: 640,
        height: 480,
        distortion_model: text(),
        d: vec![0.1; 5],
        k: vec![1.0; 9],
        r: vec![1.0; 9],
        p: vec![1.0; 12],
        frame_id: text(),
    };
    assert_eq!(met_fields(&calibration).unwrap().len(), 9 + 2);
    let image = CompressedImage { timestamp: AT, data: vec![1, 2], format: text(), frame_id: text() };
    assert_eq!(met_fields(&image).unwrap().len(), 4 + 2);
    let transform = FrameTransform {
        timestamp: AT,
        parent_frame_id: text(),
        child_frame_id: text(),
        translation: Some(POINT),
        rotation: Some(TURN),
    };
    assert_eq!(
        met_fields(&FrameTransforms { transforms: vec![transform] }).unwrap().len(),
        1 + 5 + 2 + 3 + 4
    );
    let poses = PosesInFrame { timestamp: AT, frame_id: text(), poses: vec![PLACED.unwrap()] };
    assert_eq!(met_fields(&poses).unwrap().len(), 3 + 2 + 2 + 3 + 4);
    let field = PackedElementField { name: text(), offset: 4, r#type: FLOAT32 };
    let cloud = PointCloud {
        timestamp: AT,
        frame_id: text(),
        pose: PLACED,
        point_stride: 12,
        fields: vec![field],
        data: vec![0; 12],
    };
    assert_eq!(met_fields(&cloud).unwrap().len(), 6 + 3 + 2 + 2 + 3 + 4);
    let entity = SceneEntity {
        timestamp: AT,
        frame_id: text(),
        id: text(),
        frame_locked: true,
        lines: vec![LinePrimitive {
            r#type: SCENE_LINE_LIST,
            pose: PLACED,
            thickness: 0.1,
            scale_invariant: true,
            points: vec![POINT; 2],
            color: TINT,
            indices: vec![1, 2],
        }],
        triangles: vec![TriangleListPrimitive {
            pose: PLACED,
            points: vec![POINT; 3],
            color: TINT,
            indices: vec![1, 2, 3],
        }],
    };
    let update = SceneUpdate { entities: vec![entity] };
    assert_eq!(met_fields(&update).unwrap().len(), 1 + 6 + 7 + 4 + 2 + 2 + 3 + 3 + 4 + 4);
    let points = PointsAnnotation {
        timestamp: AT,
        r#type: LINE_LOOP,
        points: vec![Point2 { x: 1.0, y: 2.0 }],
        outline_color: TINT,
        fill_color: TINT,
        thickness: 2.0,
    };
    let annotations = ImageAnnotations { points: vec![points], timestamp: AT };
    assert_eq!(met_fields(&annotations).unwrap().len(), 2 + 6 + 2 + 2 + 4);
}

/// The check itself finds a field that is not defined and one of another type.
#[test]
fn wrong_messages_are_found() {
    #[derive(Clone, PartialEq, Message)]
    struct Wrong {
        #[prost(uint32, optional, tag = "2")]
        width: Option<u32>,
        #[prost(double, tag = "77")]
        more: f64,
    }
    impl Topic for Wrong {
        const SCHEMA: &'static str = CameraCalibration::SCHEMA;
    }
    let error = met_fields(&Wrong { width: None, more: 1.0 }).unwrap_err();
    assert_eq!(error, ".foxglove.CameraCalibration has no field 77");
    let error = met_fields(&Wrong { width: Some(3), more: 0.0 }).unwrap_err();
    assert_eq!(error, ".foxglove.CameraCalibration.width: wire type 0, expected 5");
}
