// What the panels share: the store, the map, and how to act and to say so.

import { ApiError } from './api.js';
import { t, type Key } from './i18n.js';
import type { MapView } from './map/map.js';
import type { Marks } from './map/motion.js';
import type { Store } from './store.js';
import type { Toasts } from './panels/toasts.js';

export interface App {
  readonly store: Store;
  readonly map: MapView;
  readonly toasts: Toasts;
  /// Reads again what the station may have changed.
  reload(what: 'sites' | 'tags' | 'nodes' | 'zones'): Promise<void>;
  /// Shows `marks` of the past; null: live again.
  showPast(marks: Marks | null): void;
  askToken(): void;
}

/// A part of the page beside the map.
export interface Panel {
  readonly key: Key;
  readonly element: HTMLElement;
  /// The panel is shown or hidden.
  shown?(is: boolean): void;
}

/// Runs `action`; a failure is told to the person. Whether it went well.
export async function attempt(app: App, action: () => Promise<unknown>): Promise<boolean> {
  try {
    await action();
    return true;
  } catch (error) {
    if (error instanceof ApiError && error.status === 401) app.askToken();
    else if (error instanceof ApiError && error.status === 403) app.toasts.show(t('readonly'), 'bad');
    else app.toasts.show(t('failed', { message: error instanceof Error ? error.message : String(error) }), 'bad');
    return false;
  }
}
