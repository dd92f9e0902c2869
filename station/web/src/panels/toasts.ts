// Short notices in a corner, which screen readers read out; alarms stay longer.

import { h } from '../dom.js';

export type Look = 'plain' | 'good' | 'bad';

const MOST = 4;

export class Toasts {
  readonly element = h('div', {
    class: 'toasts',
    label: 'notices',
    attributes: { role: 'log', 'aria-live': 'polite', 'aria-atomic': 'false' },
  });

  show(message: string, look: Look = 'plain'): void {
    const remove = () => toast.remove();
    const toast = h(
      'div',
      { class: `toast ${look}` },
      h('span', {}, message),
      h('button', { label: 'close', attributes: { type: 'button' }, on: { click: remove } }, '×'),
    );
    this.element.append(toast);
    while (this.element.childElementCount > MOST) this.element.firstElementChild?.remove();
    setTimeout(remove, look === 'bad' ? 15_000 : 6000);
  }
}

/// Two short tones.
export function beep(): void {
  const context = new AudioContext();
  const gain = context.createGain();
  gain.gain.value = 0.15;
  gain.connect(context.destination);
  for (const [i, frequency] of [880, 660].entries()) {
    const tone = context.createOscillator();
    tone.frequency.value = frequency;
    tone.connect(gain);
    tone.start(context.currentTime + 0.18 * i);
    tone.stop(context.currentTime + 0.18 * i + 0.15);
  }
  setTimeout(() => void context.close(), 1000);
}
