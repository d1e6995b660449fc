//! Names and labels of devices.

use super::*;

#[cfg(feature = "flex")]
#[test]
fn names_are_those_of_backends() {
    let flex = parse("name", " Flex ").expect("flex");
    assert_eq!(flex, Device::flex());
    #[cfg(feature = "ndarray")]
    assert_ne!(parse("name", "ndarray").expect("ndarray"), flex);
}

#[cfg(all(feature = "flex", feature = "ndarray"))]
#[test]
fn labels_are_names() {
    for name in ["flex", "ndarray"] {
        let device = parse("name", name).expect(name);
        assert_eq!(label(&device), name);
        assert_eq!(label(&device.autodiff()), name);
    }
}

#[test]
fn other_names_are_errors() {
    for name in ["", "cuda2", "flex:cpu", "wgpu:fast", "wgpu:discrete:x"] {
        let said = parse(VARIABLE, name).expect_err(name).to_string();
        assert!(said.contains(&format!("BURN_DEVICE is {name:?}")), "{said}");
    }
}

#[test]
fn errors_of_other_backends_say_what_to_do() {
    let said = of_another_backend("Remote(ws://host:3000)".into()).to_string();
    for part in [
        "device Remote(ws://host:3000)",
        "flex",
        "wgpu",
        "`to_device`",
    ] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
}

#[cfg(feature = "flex")]
#[test]
fn backends_that_are_built_in_render() {
    assert!(check(&Device::flex()).is_ok());
    assert!(check(&Device::flex().autodiff()).is_ok());
    #[cfg(feature = "ndarray")]
    #[allow(deprecated)]
    let ndarray = Device::ndarray();
    #[cfg(feature = "ndarray")]
    assert!(check(&ndarray).is_ok());
}

#[cfg(feature = "wgpu")]
#[test]
fn kernels_run_on_gpus_alone() {
    let gpu = Device::wgpu(burn::tensor::DeviceKind::Cpu);
    assert!(check(&gpu).is_ok());
    assert!(runs_kernels(&gpu) && runs_kernels(&gpu.autodiff()));
    #[cfg(feature = "flex")]
    assert!(!runs_kernels(&Device::flex()));
}

#[cfg(not(feature = "wgpu"))]
#[test]
fn what_is_not_built_in_says_so() {
    let said = parse("name", "wgpu").expect_err("no wgpu").to_string();
    assert!(said.contains("--features wgpu"), "{said}");
}

#[cfg(feature = "wgpu")]
#[test]
fn labels_of_gpus_are_names() {
    let of = |kind| label(&Device::wgpu(gpu(kind).expect("a kind")));
    assert_eq!(of(None), "wgpu");
    assert_eq!(of(Some("cpu")), "wgpu:cpu");
    assert_eq!(of(Some("discrete:2")), "wgpu:discrete:2");
}

#[cfg(feature = "wgpu")]
#[test]
fn kinds_of_gpus() {
    use burn::tensor::DeviceKind;
    assert_eq!(gpu(None), Some(DeviceKind::DefaultDevice));
    assert_eq!(gpu(Some("cpu")), Some(DeviceKind::Cpu));
    assert_eq!(gpu(Some("discrete:1")), Some(DeviceKind::DiscreteGpu(1)));
    assert_eq!(gpu(Some("cpu:1")), None);
}
