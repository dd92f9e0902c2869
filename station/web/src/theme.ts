// Light, dark, or as the system has it.

const KEY = 'baliza.theme';

export type Theme = 'auto' | 'light' | 'dark';

export function chosenTheme(): Theme {
  const saved = localStorage.getItem(KEY);
  return saved === 'light' || saved === 'dark' ? saved : 'auto';
}

// Tells when the system changes between light and dark.
export const system = matchMedia('(prefers-color-scheme: dark)');

export function applyTheme(theme: Theme): void {
  localStorage.setItem(KEY, theme);
  const ofSystem = system.matches ? 'dark' : 'light';
  document.documentElement.dataset.theme = theme === 'auto' ? ofSystem : theme;
}
