// The module that the Designer's server makes of its registry of panels (lookdev/studio/designer/panels).

export const panels: Record<string, Panel>;
