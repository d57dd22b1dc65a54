//! One mesh as a binary glTF 2.0 file: metres, y up, facing +z, as the body frame.

use glam::DVec3;
use serde_json::json;

use super::figure::vertex_normals;

const MAGIC: u32 = 0x4654_6C67;
const VERSION: u32 = 2;
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Colour of the body, linear RGBA.
const COLOR: [f32; 4] = [0.75, 0.42, 0.25, 1.0];

/// The bytes of a file with one mesh called `name`; counter-clockwise triangles face outward.
pub fn glb(name: &str, vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let wide: Vec<DVec3> = vertices.iter().map(|v| DVec3::from_array(v.map(f64::from))).collect();
    let normals = vertex_normals(&wide, triangles);
    let mut bin = Vec::new();
    vertices.iter().flatten().for_each(|x| bin.extend(x.to_le_bytes()));
    normals.iter().flat_map(|n| n.as_vec3().to_array()).for_each(|x| bin.extend(x.to_le_bytes()));
    triangles.iter().flatten().for_each(|index| bin.extend(index.to_le_bytes()));
    let points = 12 * vertices.len();
    let bound = |of: fn(f32, f32) -> f32| -> [f32; 3] {
        [0, 1, 2].map(|axis| vertices.iter().map(|v| v[axis]).reduce(of).unwrap_or_default())
    };
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("umbra ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": name }],
        "meshes": [{ "name": name, "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2, "material": 0
        }] }],
        "materials": [{ "pbrMetallicRoughness": {
            "baseColorFactor": COLOR, "metallicFactor": 0.0, "roughnessFactor": 0.8
        } }],
        "buffers": [{ "byteLength": bin.len() }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": points, "target": ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": points, "byteLength": points, "target": ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": 2 * points, "byteLength": 12 * triangles.len(), "target": ELEMENT_ARRAY_BUFFER },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": FLOAT, "count": vertices.len(), "type": "VEC3",
              "min": bound(f32::min), "max": bound(f32::max) },
            { "bufferView": 1, "componentType": FLOAT, "count": vertices.len(), "type": "VEC3" },
            { "bufferView": 2, "componentType": UNSIGNED_INT, "count": 3 * triangles.len(), "type": "SCALAR" },
        ],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let length = 12 + 8 + text.len() + 8 + bin.len();
    let mut file = Vec::with_capacity(length);
    for word in [MAGIC, VERSION, length as u32, text.len() as u32, JSON_CHUNK] {
        file.extend(word.to_le_bytes());
    }
    file.extend(text);
    for word in [bin.len() as u32, BIN_CHUNK] {
        file.extend(word.to_le_bytes());
    }
    file.extend(bin);
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_of_the_format_finds_the_mesh() {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -3.0]];
        let triangles = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let file = glb("body", &vertices, &triangles);
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&file[..4], word(4), word(8)), (&b"glTF"[..], 2, file.len()));
        let text = &file[20..20 + word(12)];
        assert_eq!(&file[16..20], b"JSON");
        let document: serde_json::Value = serde_json::from_slice(text).unwrap();
        let bin = 20 + word(12) + 8;
        assert_eq!(&file[bin - 4..bin], b"BIN\0");
        assert_eq!(document["buffers"][0]["byteLength"], 12 * 4 * 2 + 12 * 4);
        assert_eq!(document["accessors"][0]["max"], json!([1.0, 2.0, 0.0]));
        assert_eq!(document["accessors"][0]["min"], json!([0.0, 0.0, -3.0]));
        let float = |at: usize| f32::from_le_bytes(file[at..at + 4].try_into().unwrap());
        assert_eq!(float(bin + 12 * 3 + 8), -3.0);
        let indices = document["bufferViews"][2]["byteOffset"].as_u64().unwrap() as usize;
        assert_eq!(word(bin + indices + 4), 2);
    }
}
