//! All girths of one body on one thread: the template's mesh.

use std::hint::black_box;

use biosig::Tape;
use body::BodyModel;
use criterion::{Criterion, criterion_group, criterion_main};

fn girths(criterion: &mut Criterion) {
    let model = BodyModel::builtin();
    let (tape, body) = (Tape::of_model(&model), model.mean());
    let name = format!("all girths, {} triangles", body.triangles().len());
    criterion.bench_function(&name, |bencher| bencher.iter(|| tape.measure_body(black_box(&body))));
}

criterion_group!(benches, girths);
criterion_main!(benches);
