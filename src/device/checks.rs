/// Run-time checks that wgpu adds to shaders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShaderChecks {
    /// All checks: bounds, loops, integer division.
    Full,
    /// Bounds checks only
    #[default]
    Fast,
}

impl ShaderChecks {
    pub fn runtime_checks(self) -> wgpu::ShaderRuntimeChecks {
        match self {
            Self::Full => wgpu::ShaderRuntimeChecks::checked(),
            Self::Fast => wgpu::ShaderRuntimeChecks { bounds_checks: true, ..wgpu::ShaderRuntimeChecks::unchecked() },
        }
    }
}
