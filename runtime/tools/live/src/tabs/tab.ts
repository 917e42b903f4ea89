// A tab of results.

/** Interface of a tab; it asks the server only while it is shown. */
export interface Tab {
  id: string;
  title: string;
  element: HTMLElement;
  /** The tab has come into view or left it. */
  show(visible: boolean): void;
  /** The text or the settings have changed. */
  changed(): void;
}
