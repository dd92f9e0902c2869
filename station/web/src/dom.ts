// Elements without markup: every text is textContent. Texts of the page carry their key, so that a change of the
// language finds them.

import { t, type Key } from './i18n.js';

export interface Properties {
  /// Key of the text.
  t?: Key;
  /// Key of the accessible label.
  label?: Key;
  /// Key of the placeholder.
  placeholder?: Key;
  class?: string;
  attributes?: Record<string, string | number | boolean | null | undefined>;
  on?: Partial<{ [K in keyof HTMLElementEventMap]: (event: HTMLElementEventMap[K]) => void }>;
}

export type Child = Node | string | null;

export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  properties: Properties = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  if (properties.class !== undefined) element.className = properties.class;
  if (properties.t !== undefined) element.dataset.t = properties.t;
  if (properties.label !== undefined) element.dataset.label = properties.label;
  if (properties.placeholder !== undefined) element.dataset.placeholder = properties.placeholder;
  for (const [name, value] of Object.entries(properties.attributes ?? {})) {
    if (value === true) element.setAttribute(name, '');
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
  for (const [type, listener] of Object.entries(properties.on ?? {})) {
    element.addEventListener(type, listener as EventListener);
  }
  translateOne(element);
  for (const child of children) if (child !== null) element.append(child);
  return element;
}

function translateOne(element: HTMLElement): void {
  const { t: text, label, placeholder } = element.dataset;
  if (text !== undefined) element.textContent = t(text as Key);
  if (label !== undefined) element.setAttribute('aria-label', t(label as Key));
  if (placeholder !== undefined) element.setAttribute('placeholder', t(placeholder as Key));
}

/// Writes all texts that carry their key in the current language.
export function translateAll(root: ParentNode): void {
  for (const element of root.querySelectorAll<HTMLElement>('[data-t],[data-label],[data-placeholder]')) {
    translateOne(element);
  }
}

export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

/// A label with its control inside.
export function field(key: Key, control: HTMLElement): HTMLLabelElement {
  return h('label', { class: 'field' }, h('span', { t: key }), control);
}

export function button(key: Key, press: () => void, look = ''): HTMLButtonElement {
  return h('button', { t: key, class: look, attributes: { type: 'button' }, on: { click: press } });
}

/// A button that asks once more before it acts.
export function carefulButton(key: Key, press: () => void): HTMLButtonElement {
  const element = h('button', { t: key, class: 'danger', attributes: { type: 'button' } });
  let armed = false;
  const show = (is: boolean) => {
    armed = is;
    element.dataset.t = is ? 'really' : key;
    translateOne(element);
  };
  element.addEventListener('click', () => {
    if (armed) press();
    show(!armed);
  });
  element.addEventListener('blur', () => show(false));
  return element;
}

/// A form that is hidden at first. Enter saves, Escape and a button close it, and `remove` stands beside them.
export function editForm(
  form: { id: string; label?: Key; save: () => void; close: () => void; remove: HTMLElement },
  ...children: Child[]
): HTMLFormElement {
  return h(
    'form',
    {
      class: 'form',
      label: form.label,
      attributes: { hidden: true, id: form.id },
      on: {
        submit: (event) => {
          event.preventDefault();
          form.save();
        },
        keydown: (event) => {
          if (event.key === 'Escape') form.close();
        },
      },
    },
    ...children,
    h(
      'div',
      { class: 'buttons' },
      h('button', { t: 'save', class: 'primary', attributes: { type: 'submit' } }),
      button('cancel', form.close),
      form.remove,
    ),
  );
}

export function empty(key: Key, command?: string): HTMLElement {
  return h('div', { class: 'empty' }, h('p', { t: key }), command === undefined ? null : h('code', {}, command));
}
