//! All girths of one body on one thread: on the template's mesh, and on one with sixteen times its triangles.

use std::hint::black_box;

use biosig::{Labels, Tape};
use body::BodyModel;
use body::model::Template;
use criterion::{Criterion, criterion_group, criterion_main};

/// Every triangle cut into four; the new vertices have the label of one end of their edge.
fn subdivided(mut template: Template, mut vertices: Vec<[f32; 3]>) -> (Template, Vec<[f32; 3]>) {
    let mut middles = std::collections::HashMap::new();
    let mut triangles = Vec::new();
    for [a, b, c] in template.triangles {
        let mut middle = |from: u32, to: u32| {
            *middles.entry((from.min(to), from.max(to))).or_insert_with(|| {
                let [p, q] = [from, to].map(|vertex| vertices[vertex as usize]);
                vertices.push([0, 1, 2].map(|axis| p[axis].midpoint(q[axis])));
                template.parts.push(template.parts[from as usize]);
                vertices.len() as u32 - 1
            })
        };
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    template.triangles = triangles;
    (template, vertices)
}

fn girths(criterion: &mut Criterion) {
    let model = BodyModel::builtin();
    let body = model.mean();
    let mut mesh = (model.template().clone(), body.rest_vertices().to_vec());
    for rounds in [0, 2] {
        for _ in 0..rounds {
            mesh = subdivided(mesh.0, mesh.1);
        }
        let (template, vertices) = &mesh;
        let tape = Tape::new(Labels::from(template)).expect("the template has all labels");
        let name = format!("all girths, {} triangles", template.triangles.len());
        criterion.bench_function(&name, |bencher| {
            bencher.iter(|| tape.measure(black_box(vertices), body.rest_joints()));
        });
    }
}

criterion_group!(benches, girths);
criterion_main!(benches);
