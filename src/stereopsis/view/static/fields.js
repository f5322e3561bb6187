/** What can be set on the page: data, one entry a control. Names are those of `Settings`. */

const choice = (name, label, options, more = {}) => ({ kind: "choice", name, label, options, ...more });
const toggle = (name, label, on, more = {}) => ({ kind: "switch", name, label, on, off: null, ...more });
const slider = (min, max, step, unit = "") => ({ min, max, step, unit });

/** Sliders of what an optimizer is made of. */
export const PARTS = {
  optimize_p1: ["Penalty P1", slider(1, 600, 1)],
  optimize_p2: ["Penalty P2", slider(1, 3000, 1)],
  optimize_p2_min: ["Least P2", slider(1, 1500, 1)],
  optimize_contrast: ["Contrast", slider(1, 100, 1)],
  optimize_paths: ["Paths", [4, 8]],
  smoothness_weight: ["Weight", slider(0, 5, 0.05)],
  smoothness_truncation: ["Truncation", slider(1, 32, 1)],
  optimize_iterations: ["Iterations", slider(1, 20, 1)],
};

export const GROUPS = [
  {
    title: "Matching", open: true,
    fields: [
      { kind: "cost", name: "cost", label: "Cost" },
      { kind: "window", name: "window", label: "Window" },
      { kind: "window", name: "aggregation", label: "Aggregation" },
      { kind: "range", name: "disparities", label: "Disparities" },
    ],
  },
  {
    title: "Smoothing", open: true,
    fields: [{ kind: "optimize", name: "optimize", label: "Method" }],
  },
  {
    title: "Checks", open: true,
    fields: [
      toggle("left_right", "Left–right", 1, { value: slider(0, 5, 0.25, "px") }),
      toggle("uniqueness", "Uniqueness", 2, { value: slider(0, 30, 0.5, "%") }),
      toggle("texture", "Texture", 0.3, { value: slider(0, 5, 0.1) }),
      toggle("reflection", "Reflection", 3, { value: slider(0, 10, 0.25, "σ") }),
      choice("sky", "Sky", [[false, "off"], ["auto", "over open ground"], [true, "anywhere"]]),
      toggle("speckle", "Speckle", [200, 1], { value: slider(0, 2000, 10, "px"), part: 0 }),
      toggle("least_confidence", "Least confidence", 0.85, { value: slider(0, 1, 0.01) }),
    ],
  },
  {
    title: "Refining and filling",
    fields: [
      choice("subpixel", "Sub-pixel", [null, "parabola", "equiangular", "symmetric", "correlation", "lucas-kanade", "lucas-kanade-affine"]),
      choice("slant", "Slant", [null, "road", "planes"]),
      toggle("median", "Median", 3, { value: slider(1, 15, 2, "px") }),
      toggle("weighted_median", "Weighted median", [7, 10], { value: slider(1, 11, 2, "px"), part: 0 }),
      toggle("outlines", "Outlines", true, { off: false }),
      toggle("photometric", "Photometric", true, { off: false }),
      toggle("edge_aware", "Edge-aware", [100, 5], { value: slider(0, 1000, 10), part: 0 }),
      choice("fill", "Filling", [null, "background", "interpolate", "surfaces"]),
    ],
  },
  {
    title: "More",
    fields: [
      choice("sharpen", "Sharpen", [[null, "as they are"], ["auto", "undo blur"]]),
      choice("blank", "Black borders", [[false, "as they are"], [true, "leave out"]]),
      choice("vertical", "Rows", [[null, "as they are"], ["estimate", "undo what is off"]]),
      choice("channels", "Channels", ["grey", "separate"]),
      choice("confidence", "Confidence", [[null, "sharpness"], "calibrated"]),
      choice("pyramid", "Coarse to fine", [[null, "off"], [1, "1 level"], [2, "2 levels"], [3, "3 levels"]]),
      choice("step", "Every", [[1, "pixel"], [2, "2nd pixel"], [4, "4th pixel"]]),
    ],
  },
];
