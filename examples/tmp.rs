use burn::tensor::*;
fn show(n: &str, t: Tensor<2>) {
    println!("{n}: {:?}", t.into_data().iter::<f32>().collect::<Vec<_>>());
}
fn main() {
    let vulkan = std::env::args().nth(1).as_deref() == Some("vulkan");
    for dev in [
        Device::flex(),
        if vulkan {
            Device::vulkan(DeviceKind::Cpu)
        } else {
            Device::wgpu(DeviceKind::Cpu)
        },
    ] {
        println!("{dev:?}");
        let a = Tensor::<2>::from_data(
            TensorData::new(
                (0..6).map(|x| x as f32 * 0.5 - 1.0).collect::<Vec<_>>(),
                [2, 3],
            ),
            &dev,
        );
        let b = Tensor::<2>::from_data(
            TensorData::new(
                (0..12).map(|x| x as f32 * 0.3 - 1.0).collect::<Vec<_>>(),
                [3, 4],
            ),
            &dev,
        );
        let m = a.clone().matmul(b.clone());
        show("matmul", m.clone());
        show("abs", m.clone().abs());
        let g = m.clone().abs().greater_elem(1e-6);
        show("greater", g.clone().float());
        let valid = Tensor::<2, Bool>::from_data(TensorData::new(vec![true, false], [2, 1]), &dev);
        show("valid", valid.clone().float());
        show("expand", valid.clone().expand([2, 4]).float());
        show(
            "and",
            g.clone().bool_and(valid.clone().expand([2, 4])).float(),
        );
        show("not", g.clone().bool_not().float());
        show("mask_fill", m.clone().mask_fill(g.clone().bool_not(), 1.0));
        show("lower big", m.clone().lower_elem(1e29).float());
        show("cumsum", m.clone().cumsum(0));
        show("intsum", g.clone().int().sum_dim(0).float());
        let i = Tensor::<2, Int>::from_data(TensorData::new(vec![0i32, 3, 1], [1, 3]), &dev);
        show("gather", m.clone().slice([0..1]).gather(1, i));
        show("reshape narrow", a.clone().narrow(1, 1, 1).reshape([1, 2]));
        show("cast", g.float().cast(DType::F32));
        show("maxdim", m.clone().max_dim(0));
        show("exp", (m.clone() * (-1.0)).exp());
        show("recip", m.clone().recip());
        show("clamp", m.clone().clamp(0.0, 1.0));
        show("minpair", m.clone().min_pair(m.clone() * 2.0));
    }
}
