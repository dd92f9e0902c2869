// The dialog that asks who one is: a token, or a sign-in at a provider, from which the browser comes back to the page
// with what has failed after the `#`.

import { api, ApiError } from '../api.js';
import { button, field, h } from '../dom.js';
import { isKey, t, type Key } from '../i18n.js';

export class Login {
  private readonly token = h('input', {
    attributes: { type: 'password', id: 'token', autocomplete: 'current-password', required: true },
  });
  private readonly problem = h('p', { class: 'problem', attributes: { role: 'alert' } });
  /// The address where one signs in; null: tokens only.
  private provider: string | null = null;
  private readonly inButton = button(
    'login.in',
    () => {
      if (this.provider !== null) location.assign(this.provider);
    },
    'primary',
  );
  private readonly signIn = h('div', { class: 'form' }, this.inButton, h('p', { t: 'login.or' }));
  readonly element: HTMLDialogElement;

  constructor(private readonly done: () => void) {
    this.element = h(
      'dialog',
      { attributes: { id: 'login', 'aria-labelledby': 'login-title' } },
      h(
        'form',
        {
          class: 'form',
          on: {
            submit: (event) => {
              event.preventDefault();
              void this.send();
            },
          },
        },
        h('h2', { t: 'login.title', attributes: { id: 'login-title' } }),
        this.problem,
        this.signIn,
        h('p', { t: 'login.help' }),
        field('login.token', this.token),
        h(
          'div',
          { class: 'buttons' },
          h('button', { t: 'login', class: 'primary', attributes: { type: 'submit' } }),
          button('cancel', () => this.element.close()),
        ),
      ),
    );
  }

  /// Asks, where `provider` is the address where one signs in.
  ask(provider: string | null): void {
    if (this.element.open) return;
    const failed = takeFailure();
    this.problem.textContent = failed === null ? '' : t(failed);
    this.provider = provider;
    this.signIn.hidden = provider === null;
    this.element.showModal();
    (provider === null ? this.token : this.inButton).focus();
  }

  private async send(): Promise<void> {
    try {
      await api.login(this.token.value.trim());
    } catch (error) {
      const refused = error instanceof ApiError && (error.status === 401 || error.status === 403);
      const message = error instanceof Error ? error.message : String(error);
      this.problem.textContent = refused ? t('login.wrong') : t('failed', { message });
      return;
    }
    this.token.value = '';
    this.element.close();
    this.done();
  }
}

/// Why the last sign-in has failed, once: the address is without it then.
function takeFailure(): Key | null {
  const found = /^#(sign-in)=([a-z-]+)$/.exec(location.hash);
  if (found === null) return null;
  history.replaceState(null, '', location.pathname + location.search);
  const key = `${found[1]}.${found[2]}`;
  return isKey(key) ? key : null;
}
