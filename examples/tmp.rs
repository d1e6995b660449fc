use softray::prelude::*;
fn main(){
  let device=Device::flex();
  let ball = Object::new(shapes::icosphere(0, &device)).material(Material::diffuse([1.0; 3]));
  let camera = Camera::look_at([0.0, 0.5, 3.0], [0.0; 3]).fov_y(30.0);
  let options = RenderOptions::new(8, 8).samples(4).bounces(0).blur(1e-3, 1e-3).with_opacity();
  let image = render(&Scene::new().environment([0.7;3]).with(ball), &camera, &options).unwrap();
  println!("{:?}", image.mean());
}
