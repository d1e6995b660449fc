//! What a scene does not need is not put on the tape: its nodes are counted. One test, in a process
//! of its own: nodes are numbered by one counter.

mod common;

use burn::tensor::{DType, Device, Tensor};
use common::stress::{Thing, World};
use softray::prelude::*;

/// The number of the next node of the tape.
fn next_node() -> u64 {
    let leaf = Tensor::<1>::zeros([1], &Device::flex())
        .autodiff()
        .require_grad();
    let text = format!("{:?}", leaf.into_dispatch());
    let at = text
        .find("NodeId")
        .expect("a node in the tensor's description");
    let digits: String = text[at..]
        .chars()
        .skip_while(|c| !c.is_ascii_digit())
        .take_while(char::is_ascii_digit)
        .collect();
    digits.parse().expect("a number")
}

/// Nodes that forward takes, the scene's own parameters included.
fn nodes(world: &World) -> u64 {
    let before = next_node();
    world.run(&Device::flex(), DType::F32).expect("an image");
    next_node() - before
}

fn plain() -> World {
    World::new().with(|w| {
        w.thing("ball").gloss = None;
        w.options = RenderOptions::new(8, 8)
            .samples(2)
            .bounces(1)
            .sigma(1e-3)
            .fused(false);
    })
}

#[test]
fn features_cost_nodes_only_where_they_are() {
    let base = nodes(&plain());
    assert_eq!(base, nodes(&plain()), "the count repeats");
    let more = |name: &str, f: &dyn Fn(&mut World)| {
        let found = nodes(&plain().with(|w| f(w)));
        println!(
            "{name}: {} nodes more than {base}",
            found as i64 - base as i64
        );
        assert!(found > base + 10, "{name}: {found}, without it {base}");
    };
    more("gloss", &|w| w.thing("ball").gloss = Some(([0.3; 3], 5.0)));
    more("velocity", &|w| w.thing("ball").velocity = Some([0.1; 3]));
    more("lens", &|w| w.lens = Some((0.1, 4.0)));
    more("bounce", &|w| w.options = w.options.clone().bounces(2));
    more("texture", &|w| {
        let uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        w.thing("floor").texture = Some(([2, 2], vec![0.5; 12], uvs));
    });
    let less = |name: &str, f: &dyn Fn(&mut World)| {
        let found = nodes(&plain().with(|w| f(w)));
        println!(
            "{name}: {} nodes fewer than {base}",
            base as i64 - found as i64
        );
        assert!(found + 10 < base, "{name}: {found}, with it {base}");
    };
    less("no bounce", &|w| w.options = w.options.clone().bounces(0));
    less("no emitter", &|w| {
        w.things.retain(|t: &Thing| t.name != "light")
    });

    // A replay is one node beside those that gather the parameters and use the image.
    let replayed = nodes(&plain().with(|w| w.options = w.options.clone().replay()));
    println!("replay: {replayed} nodes forward and backward");

    // A scene of constants takes none.
    let device = Device::flex();
    let scene = Scene::new()
        .with(Object::new(shapes::icosphere(1, &device)))
        .environment([1.0; 3]);
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]);
    let before = next_node();
    render(&scene, &camera, &RenderOptions::new(8, 8).samples(2)).expect("an image");
    assert_eq!(next_node() - before, 1);
}
