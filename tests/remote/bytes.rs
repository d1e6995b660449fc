//! What a step sends: a proxy between client and server counts it.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use softray::prelude::*;
use softray::remote::{connect, finish};

use crate::server::{Server, TOKEN};

/// Passes bytes on, and counts those to the server.
pub struct Proxy {
    pub address: String,
    sent: Arc<AtomicUsize>,
}

impl Proxy {
    pub fn new(server: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let (server, sent) = (server.to_owned(), Arc::new(AtomicUsize::new(0)));
        let counted = sent.clone();
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                let server = TcpStream::connect(&server).expect("the server");
                for socket in [&client, &server] {
                    socket.set_nodelay(true).expect("a socket");
                }
                let clone = |socket: &TcpStream| socket.try_clone().expect("a socket");
                pass(clone(&client), clone(&server), Some(counted.clone()));
                pass(server, client, None);
            }
        });
        Self { address, sent }
    }

    /// The bytes to the server since the last call.
    pub fn take(&self) -> usize {
        self.sent.swap(0, Ordering::SeqCst)
    }
}

fn pass(mut from: TcpStream, mut to: TcpStream, count: Option<Arc<AtomicUsize>>) {
    std::thread::spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        while let Ok(read @ 1..) = from.read(&mut buffer) {
            if let Some(count) = &count {
                count.fetch_add(read, Ordering::SeqCst);
            }
            if to.write_all(&buffer[..read]).is_err() {
                return;
            }
        }
    });
}

/// The bytes of a step that sends vertices, and the bytes of these. The first step sends everything.
fn steps(proxy: &Proxy, subdivisions: u32) -> ([usize; 2], usize) {
    let device = connect(&format!("ws://{}", proxy.address), TOKEN).expect("a device");
    let ball = shapes::icosphere(subdivisions, &Device::flex());
    let moved = ball.vertices.dims().iter().product::<usize>() * 4;
    let sent = [0u8, 1].map(|step| {
        let vertices = (ball.vertices.clone() * (1.0 + 0.1 * f64::from(step))).into_data();
        let vertices = Tensor::<2>::from_data(vertices, &device)
            .autodiff()
            .require_grad();
        let body = Object::new(Mesh::new(vertices.clone(), ball.faces.to_vec()));
        let scene = Scene::new().with_object(body).with_environment([1.0; 3]);
        let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
        let options = RenderOptions::new(8, 8)
            .with_samples(1)
            .with_seed(step.into());
        let image = render(&scene, &camera, &options).expect("an image");
        let gradients = image.radiance.sum().backward();
        let gradient = vertices.grad(&gradients).expect("a gradient").into_data();
        assert!(gradient.iter::<f32>().any(|g| g != 0.0));
        finish(&device).expect("a gradient");
        proxy.take()
    });
    (sent, moved)
}

#[test]
fn a_second_step_sends_what_moved() {
    let server = Server::start();
    let proxy = Proxy::new(&server.address);
    for subdivisions in [1, 3, 5] {
        let ([first, second], moved) = steps(&proxy, subdivisions);
        println!(
            "{subdivisions} subdivisions: {first} bytes, then {second}, of which {moved} moved"
        );
        assert!(
            second < moved + 2000,
            "{second} bytes, of which {moved} moved"
        );
        assert!(
            first > second + moved,
            "faces are sent once: {first}, then {second}"
        );
    }
}

/// A step with copies of a scene, whose albedo and vertices have gradients, sends their tensors once.
#[test]
fn copies_of_a_scene_are_sent_once() {
    let server = Server::start();
    let proxy = Proxy::new(&server.address);
    let device = connect(&format!("ws://{}", proxy.address), TOKEN).expect("a device");
    let ball = shapes::icosphere(1, &device);
    let [one, many] = [2, 50].map(|copies| {
        let steps = [0.5, 0.6].map(|value: f32| {
            let albedo = Tensor::<1>::from_floats([value; 3], &device).autodiff();
            let albedo = albedo.require_grad();
            let vertices = ball.vertices.clone().autodiff().require_grad();
            let body = Object::new(ball.clone().with_vertices(vertices));
            let body = body.with_material(Material::diffuse(albedo.clone()));
            let scene = Scene::new().with_object(body).with_environment([1.0; 3]);
            let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
            let batch = Batch::new(vec![scene; copies], vec![camera]).expect("a batch");
            let options = RenderOptions::new(4, 4).with_samples(1);
            let images = render_batch(&batch, &options).expect("images");
            let gradients = images.radiance.mean().backward();
            assert!(albedo.grad(&gradients).is_some());
            finish(&device).expect("a gradient");
            proxy.take()
        });
        steps[1]
    });
    println!("a second step with 2 copies: {one} bytes, with 50: {many}");
    assert!(many < one + 100, "{one} bytes, then {many}");
}
