mod common;
use gravisight::physics::*;
use nalgebra::{Point3, Vector3};
#[derive(serde::Deserialize)]
struct Track { world: Vec<[f64; 3]>, velocity: Vec<[f64; 3]>, scene: serde_json::Value }
#[test]
fn defects() {
    let tracks: Vec<Track> = serde_json::from_slice(&std::fs::read("/work/data/tracks_train.json").unwrap()).unwrap();
    let (mut fr, mut fv, mut cr, mut cv, mut crel, mut en) = (vec![], vec![], vec![], vec![], vec![], vec![]);
    for t in &tracks {
        let f = Forecaster::new(&Scene::from_json(&t.scene.to_string(), "x").unwrap()).unwrap();
        let st = |k: usize| State { position: Point3::from(t.world[k]), velocity: Vector3::from(t.velocity[k]) };
        let mut k = 0;
        while k + 4 < t.world.len() {
            let one = f.forecast(&st(k), &[1.0 / 15.0]);
            let touch = !one.impacts.is_empty();
            if touch && k > 0 {
                // whole contact: 4 frames from before
                let w = f.forecast(&st(k), &[4.0 / 15.0]);
                let e = w.states[0]; let tr = st(k + 4);
                cr.push((e.position - tr.position).norm()); cv.push((e.velocity - tr.velocity).norm());
                crel.push((e.velocity - tr.velocity).norm() / (st(k).velocity - tr.velocity).norm());
                en.push(tr.velocity.norm() / e.velocity.norm() - 1.0);
                k += 4; continue;
            }
            let e = one.states[0]; let tr = st(k + 1);
            fr.push((e.position - tr.position).norm()); fv.push((e.velocity - tr.velocity).norm());
            k += 1;
        }
    }
    for (n, mut v) in [("flight r", fr), ("flight v", fv), ("contact r", cr), ("contact v", cv), ("contact rel", crel), ("speed ratio", en)] {
        v.sort_by(f64::total_cmp);
        println!("{n}: n {} rms {:.6} median {:.6} p10 {:.6} p90 {:.6} max {:.6}", v.len(), (v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64).sqrt(), v[v.len() / 2], v[v.len() / 10], v[v.len() * 9 / 10], v[v.len() - 1]);
    }
}
