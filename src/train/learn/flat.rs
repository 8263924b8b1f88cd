//! A network's numbers one after the other in a vector: what is done with each of them takes a few operations, not a few for
//! each tensor, and a GPU's time goes by operations.

use std::collections::HashMap;
use std::ops::Range;

use burn::module::{Module as _, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

use crate::model::Pen;

/// Where a network's tensors lie in a vector.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Layout {
    places: HashMap<ParamId, Range<usize>>,
    length: usize,
}

/// Gradients as a vector.
#[derive(Debug, Clone)]
pub struct Gradients {
    /// Where each tensor's are.
    pub layout: Layout,
    /// All of them.
    pub values: Tensor<1>,
}

impl Gradients {
    /// Those of `pen` among `gradients`; none where there are none.
    pub fn of(pen: &Pen, gradients: GradientsParams) -> Option<Self> {
        let mut found = OfGradients { gradients, layout: Layout::default(), parts: vec![] };
        pen.visit(&mut found);
        let OfGradients { layout, parts, .. } = found;
        if parts.is_empty() { None } else { Some(Self { layout, values: Tensor::cat(parts, 0) }) }
    }
}

impl Layout {
    /// All tensors of `pen`, its norms' statistics among them.
    pub fn of(pen: &Pen) -> Self {
        let mut layout = Self::default();
        pen.visit(&mut OfAll(&mut layout));
        layout
    }

    fn add(&mut self, id: ParamId, count: usize) {
        self.places.insert(id, self.length..self.length + count);
        self.length += count;
    }

    /// The numbers of `pen`, a network without gradients, that have a place here.
    pub fn gather(&self, pen: &Pen) -> Tensor<1> {
        let mut found = Gather { layout: self, parts: vec![] };
        pen.visit(&mut found);
        Tensor::cat(found.parts, 0)
    }

    /// `pen` with `values`, which have no gradients, in the places of its own; a network with gradients goes on having them.
    pub fn scatter(&self, pen: Pen, values: &Tensor<1>) -> Pen {
        pen.map(&mut Scatter { layout: self, values })
    }

    /// The same, zero where no place is.
    pub fn scatter_over_zeros(&self, pen: Pen, values: &Tensor<1>) -> Pen {
        self.scatter(Self::zeros(pen), values)
    }

    /// `pen` with zeros alone.
    pub fn zeros(pen: Pen) -> Pen {
        pen.map(&mut Zeros)
    }
}

struct OfGradients {
    gradients: GradientsParams,
    layout: Layout,
    parts: Vec<Tensor<1>>,
}

impl ModuleVisitor for OfGradients {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.remove::<D>(param.id) {
            self.layout.add(param.id, gradient.shape().num_elements());
            self.parts.push(gradient.reshape([-1]));
        }
    }
}

struct OfAll<'a>(&'a mut Layout);

impl ModuleVisitor for OfAll<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.add(param.id, param.val().shape().num_elements());
    }
}

struct Gather<'a> {
    layout: &'a Layout,
    parts: Vec<Tensor<1>>,
}

impl ModuleVisitor for Gather<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if self.layout.places.contains_key(&param.id) {
            self.parts.push(param.val().reshape([-1]));
        }
    }
}

struct Scatter<'a> {
    layout: &'a Layout,
    values: &'a Tensor<1>,
}

impl ModuleMapper for Scatter<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(place) = self.layout.places.get(&param.id) else { return param };
        let values = self.values.clone().slice([place.clone()]);
        param.map(|before| {
            let values = values.reshape(before.dims());
            match (before.device().is_autodiff(), before.is_require_grad()) {
                (true, true) => Tensor::from_inner(values).require_grad(),
                (true, false) => Tensor::from_inner(values),
                (false, _) => values,
            }
        })
    }
}

struct Zeros;

impl ModuleMapper for Zeros {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|before| before.zeros_like())
    }
}
