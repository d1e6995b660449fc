//! The optimizer of the network: Muon, which needs fewer steps than AdamW, where it applies.

use burn::module::ParamGroup;
use burn::optim::decay::WeightDecayConfig;
use burn::optim::{
    AdamWConfig, AdjustLrFn, LearningRate, ModuleOptimizer, Muon, MuonConfig, MuonState, Optimizer,
};
use burn::tensor::{Device, Tensor};

const WEIGHT_DECAY: f32 = 0.01;

/// Muon (Jordan et al. 2024) for kernels of convolutions, as matrices `[output, input · height · width]`.
#[derive(Clone)]
struct Kernels(Muon);

impl Optimizer for Kernels {
    type State<const D: usize> = MuonState<2>;

    fn step<const D: usize>(
        &self,
        rate: LearningRate,
        tensor: Tensor<D>,
        gradient: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        let dims = tensor.dims();
        let [tensor, gradient] = [tensor, gradient].map(|t| t.reshape([dims[0] as i32, -1]));
        let (tensor, state) = self.0.step::<2>(rate, tensor, gradient, state);
        (tensor.reshape(dims), state)
    }

    fn to_device<const D: usize>(state: Self::State<D>, device: &Device) -> Self::State<D> {
        Muon::to_device::<2>(state, device)
    }
}

/// Muon for the kernels of residual levels, and AdamW for the other parameters.
pub fn optimizer() -> ModuleOptimizer {
    let decay = WeightDecayConfig::new(WEIGHT_DECAY);
    let muon = MuonConfig::new()
        .with_weight_decay(Some(decay))
        .with_adjust_lr_fn(AdjustLrFn::MatchRmsAdamW);
    let kernels = ParamGroup::from_regex(r"levels\.\d+\.(convolutions\.\d+|shortcut)\.weight$");
    let kernels = kernels.expect("a pattern");
    let other = AdamWConfig::new().with_weight_decay(WEIGHT_DECAY).init();
    other.with_group(kernels, Kernels(muon.build()), None)
}
