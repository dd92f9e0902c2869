// The dialog that asks for a token.

import { api, ApiError } from '../api.js';
import { button, field, h } from '../dom.js';
import { t } from '../i18n.js';

export class Login {
  private readonly token = h('input', {
    attributes: { type: 'password', id: 'token', autocomplete: 'current-password', required: true },
  });
  private readonly problem = h('p', { class: 'problem', attributes: { role: 'alert' } });
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
        h('p', { t: 'login.help' }),
        field('login.token', this.token),
        this.problem,
        h(
          'div',
          { class: 'buttons' },
          h('button', { t: 'login', class: 'primary', attributes: { type: 'submit' } }),
          button('cancel', () => this.element.close()),
        ),
      ),
    );
  }

  ask(): void {
    if (this.element.open) return;
    this.problem.textContent = '';
    this.element.showModal();
    this.token.focus();
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
