//! Kernels in command encoders and on buffers of somebody else's.

use super::{Gpu, Link, Pipeline, TO, dispatch};
use crate::{Error, lock::lock};
use raykd_kernels::Kernel;

/// How many workgroups are encoded.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Size<'a> {
    /// As many as cover so many lanes.
    Lanes(u32),
    /// As the first three words of a buffer say.
    Words(&'a wgpu::Buffer),
}

impl Gpu {
    /// A buffer with some words in it, filled before anything that is submitted later.
    pub(crate) fn filled(&self, name: &'static str, words: &[u32]) -> Result<wgpu::Buffer, Error> {
        use wgpu::BufferUsages as Use;
        let link: &Link = &self.link;
        link.check()?;
        self.count(TO, size_of_val(words));
        let descriptor = wgpu::BufferDescriptor {
            label: Some(name),
            size: size_of_val(words) as u64,
            usage: Use::STORAGE | Use::COPY_SRC | Use::INDIRECT,
            mapped_at_creation: true,
        };
        link.guard(format_args!("writing {name}"), || {
            let buffer = link.device.create_buffer(&descriptor);
            if let Ok(mut view) = buffer.get_mapped_range_mut(..) {
                view.copy_from_slice(bytemuck::cast_slice(words));
            }
            buffer.unmap();
            buffer
        })
    }

    /// Encodes one dispatch of a kernel over resources in binding order.
    pub(crate) fn encode_one(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        kernel: &'static Kernel,
        resources: &[wgpu::BindingResource<'_>],
        size: Size<'_>,
    ) -> Result<(), Error> {
        assert_eq!(resources.len(), kernel.slots.len(), "buffers of {}", kernel.name());
        self.prepare(&[kernel])?;
        let Pipeline { layout, pipeline } = lock(&self.pipelines)[kernel.path].clone();
        let doing = format!("encoding kernel {}", kernel.name());
        // Before the pass begins: an encoder with a pass that fails is of no use any more.
        let group = self.link.guard(&doing, || self.bind(&layout, resources.iter().cloned()))?;
        self.link.guard(&doing, || {
            let descriptor =
                wgpu::ComputePassDescriptor { label: Some(kernel.name()), timestamp_writes: None };
            let mut pass = encoder.begin_compute_pass(&descriptor);
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            match size {
                Size::Words(args) => pass.dispatch_workgroups_indirect(args, 0),
                Size::Lanes(lanes) => dispatch(&mut pass, lanes.div_ceil(kernel.threads)),
            }
        })
    }
}
