// A certified provider of OpenID Connect (`oidc-provider`) with its own forms, and people of the groups that their names
// say: whoever signs in as `ana@staff` is in the group `staff`.

import { createServer, type Server } from 'node:http';
import type { AddressInfo } from 'node:net';
import { Provider as Oidc } from 'oidc-provider';

export const CLIENT = { id: 'baliza', secret: 'a-secret-of-the-client' };

export class Provider {
  private constructor(
    readonly issuer: string,
    private readonly server: Server,
  ) {}

  /// Starts one that sends browsers back to `station` only.
  static async start(station: string): Promise<Provider> {
    const server = createServer();
    await new Promise<void>((resolve) => server.listen(0, '127.0.0.1', resolve));
    // Another name than the station's: to browsers, it is another site.
    const issuer = `http://localhost:${(server.address() as AddressInfo).port}`;
    const oidc = new Oidc(issuer, {
      clients: [
        {
          client_id: CLIENT.id,
          client_secret: CLIENT.secret,
          redirect_uris: [`${station}/oidc/callback`],
          post_logout_redirect_uris: [`${station}/`],
          grant_types: ['authorization_code'],
          response_types: ['code'],
        },
      ],
      // The scope `profile` tells the groups. As the standard has it, at the address for user information.
      claims: { openid: ['sub'], profile: ['preferred_username', 'groups'] },
      pkce: { required: () => true },
      cookies: { keys: ['for tests'] },
      findAccount: (_context: unknown, id: string) => ({
        accountId: id,
        claims: () => {
          const [name, ...groups] = id.split('@');
          return { sub: id, preferred_username: name, groups };
        },
      }),
    });
    server.on('request', oidc.callback());
    return new Provider(issuer, server);
  }

  async stop(): Promise<void> {
    this.server.closeAllConnections();
    await new Promise((resolve) => this.server.close(resolve));
  }
}
