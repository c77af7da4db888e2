//! The block-tridiagonal solve: our kernels, with wide instructions and with those that every processor has, beside `nalgebra`'s
//! Cholesky and products on the same recursion, in one run.
//!
//! `cargo bench -p nav-fgo`

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nav_fgo::chain::Link;
use nav_fgo::kernels::{Block, BlockVector};
use nav_models::wide;
use std::hint::black_box;

const N: usize = 15;

fn links(count: usize) -> Vec<Link<N>> {
    let noise = |seed: usize| ((seed as f64 * 12.9898).sin() * 43758.5453).fract();
    (0..count)
        .map(|k| {
            let raw = Block::<N>::from_fn(|i, j| noise(1 + k * 1000 + i * 15 + j));
            let mut link = Link::default();
            link.diagonal = raw * raw.transpose() + Block::identity() * 20.0;
            link.next_transposed = Block::from_fn(|i, j| noise(500 + k * 999 + i + 15 * j));
            link.right = BlockVector::from_fn(|i, _| noise(77 + k * 31 + i));
            link
        })
        .collect()
}

/// Sweep and substitution with this crate's kernels; returns the oldest step.
#[inline(always)]
fn ours(links: &mut [Link<N>]) -> BlockVector<N> {
    for k in 0..links.len() {
        let (before, rest) = links.split_at_mut(k);
        rest[0].sweep(before.last(), 0.0).expect("positive definite");
    }
    let mut delta: Option<BlockVector<N>> = None;
    for link in links.iter().rev() {
        delta = Some(link.substitute(delta.as_ref()));
    }
    delta.expect("there are links")
}

/// The same with `nalgebra`.
#[inline(always)]
fn theirs(links: &[Link<N>]) -> BlockVector<N> {
    let mut swept = Vec::with_capacity(links.len());
    let (mut diagonal, mut right) = (links[0].diagonal, links[0].right);
    for (k, link) in links.iter().enumerate() {
        let l = diagonal.cholesky().expect("positive definite").unpack();
        let coupling = link.next_transposed.transpose();
        let y_matrix = l.solve_lower_triangular(&coupling).expect("regular");
        let y = l.solve_lower_triangular(&right).expect("regular");
        if let Some(next) = links.get(k + 1) {
            diagonal = next.diagonal - y_matrix.transpose() * y_matrix;
            right = next.right - y_matrix.transpose() * y;
        }
        swept.push((l, y_matrix, y));
    }
    let mut delta = BlockVector::<N>::zeros();
    for (k, (l, y_matrix, y)) in swept.iter().enumerate().rev() {
        let right = if k + 1 == links.len() { *y } else { y - y_matrix * delta };
        delta = l.tr_solve_lower_triangular(&right).expect("regular");
    }
    delta
}

fn solves(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("block_tridiagonal");
    for count in [20, 200] {
        let mut chain = links(count);
        let difference = (ours(&mut chain) - theirs(&chain)).amax();
        assert!(difference < 1e-12, "{difference}");
        group.bench_with_input(BenchmarkId::new("ours", count), &count, |bencher, _| {
            bencher.iter(|| black_box(wide!(ours(black_box(&mut chain)))));
        });
        group.bench_with_input(BenchmarkId::new("ours, narrow instructions", count), &count, |bencher, _| {
            bencher.iter(|| black_box(ours(black_box(&mut chain))));
        });
        group.bench_with_input(BenchmarkId::new("ours, substitution alone", count), &count, |bencher, _| {
            bencher.iter(|| {
                let mut delta: Option<BlockVector<N>> = None;
                for link in chain.iter().rev() {
                    delta = Some(wide!(link.substitute(delta.as_ref())));
                }
                black_box(delta)
            });
        });
        group.bench_with_input(BenchmarkId::new("nalgebra", count), &count, |bencher, _| {
            bencher.iter(|| black_box(wide!(theirs(black_box(&chain)))));
        });
    }
    group.finish();
}

criterion_group!(benches, solves);
criterion_main!(benches);
