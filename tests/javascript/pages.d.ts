// What the pages know and the compiler cannot: types of elements by their ids, and what scripts share.

interface Document {
  getElementById(id: string): any;
}

interface ParentNode {
  querySelector(selectors: string): any;
  querySelectorAll(selectors: string): any;
}

interface Element {
  closest(selectors: string): any;
}

/** The parts of the review page, which its scripts share: it opens from disk, where modules are refused. */
declare const review: any;

interface Window {
  review: any;
  viewport: any;
  designer: any;
  explorer: any;
}

/** A panel of the Designer's page, which its module exports as `panel`. */
interface Panel {
  /** The HTML of the panel, by the selectors of the elements that get it. */
  markup: Record<string, string>;
  /** Give the panel its behaviour, once its HTML is in the page. `designer` is a `Designer` (designer.js). */
  mount(designer: any): MountedPanel | void;
}

interface MountedPanel {
  /** Acts of keys, for instance "v" or "Ctrl+z"; an act that returns false leaves the key to others. */
  keys?: Record<string, () => unknown>;
  /** Prepare for another scene, which the viewport shows already; `designer.scene` is it in the next `update`. */
  load?(scene: any): unknown;
  /** Show the document as it is after a change, or another picked part. */
  update?(scene: any): void;
}

interface Navigator {
  deviceMemory?: number;
}
