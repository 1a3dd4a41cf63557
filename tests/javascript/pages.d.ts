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
  exact: any;
  explorer: any;
}

interface Navigator {
  deviceMemory?: number;
}
